"""The light and the hue of what no photo shows, and detail that a lattice can hold."""

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.face.one_photo.paint import LIT, Relief, Shot, _fill, _grain, _Mean
from lfportrait.face.one_photo.shade import LUMINANCE, Hue, Light, open_around

SKIN = np.array([0.5, 0.36, 0.3])


def block(step: float = 0.01) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, normals and how far outside: of a floor, and of a wall that stands on it."""
    x, y, z = np.meshgrid(*(np.arange(-0.5, 0.5, step) for _ in range(3)), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    floor, wall = points[:, 1], points[:, 0] + 0.2
    away = np.minimum(floor, wall)
    # Below its floor and behind its wall it is solid.
    normals = np.where((floor < wall)[:, None], (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    near = away < 2 * step
    return points[near], normals[near], away[near]


def ball_with_groove(voxel: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of a shell around a ball with a groove around its middle: within it is empty."""
    axis = np.arange(-0.62, 0.62, voxel)
    points = np.stack([one.ravel() for one in np.meshgrid(axis, axis, axis, indexing="ij")], axis=1)
    far = np.linalg.norm(points, axis=1)
    radius = 0.5 - 0.12 * np.exp(-(points[:, 1] / 0.06) ** 2)
    away = far - radius
    near = (away > -4 * voxel) & (away < 2 * voxel)
    return points[near], points[near] / far[near, None], away[near]


def test_a_corner_is_less_open_than_a_plain():
    points, normals, away = block()
    free = open_around(points, normals, away, 0.01)
    x, _, z = points.T
    middle = (normals[:, 1] > 0) & (np.abs(away) < 0.02) & (np.abs(z) < 0.1)
    plain, corner = free[middle & (np.abs(x - 0.2) < 0.03)], free[middle & (x < -0.15)]
    assert len(plain) > 50 and len(corner) > 50
    assert np.abs(plain - 1).max() < 0.12
    assert corner.max() < 0.8


@pytest.mark.parametrize("voxel", [0.012, 2 / 96])
def test_a_groove_is_less_open_than_what_is_around_it(voxel):
    points, normals, away = ball_with_groove(voxel)
    free = open_around(points, normals, away, voxel)
    height = np.abs(points[:, 1])
    assert free[height < 0.02].max() < 0.85
    # A ball is more open than a plain.
    assert 0.95 < free[(height > 0.3) & (np.abs(away) < voxel)].mean() < 1.2


def test_a_light_is_known_where_a_photo_does_not_look():
    normals = np.random.default_rng(0).standard_normal((4000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    free = np.random.default_rng(1).uniform(0.3, 1.0, 4000)
    true = SKIN * np.exp(0.3 * normals[:, 1:2] + 0.4 * np.log(free)[:, None])
    seen = np.clip(normals[:, 2], 0, 1)  # from the front
    found = Light.of(normals, free, true, seen).at(normals, free)
    level = true / found
    assert np.std(np.log(level[seen == 0]), axis=0).max() < 0.25 * np.std(np.log(true))
    # What turns away is no darker than all that is seen.
    dim = SKIN * np.exp(0.6 * (normals[:, 2:] - 1))
    away = Light.of(normals, np.ones(4000), dim, seen).at(normals, np.ones(4000))
    assert away[normals[:, 2] < 0].min() > 0.9 * away[seen > 0.5].min()
    # Without a light there is none.
    plain = Light.of(normals, free, np.tile(SKIN, (4000, 1)), seen).at(normals, free)
    assert np.abs(plain - 1).max() < 1e-6


def test_a_cheek_that_is_not_seen_goes_on_in_its_light():
    # A ball lit from above, of which the front is seen.
    points = np.random.default_rng(0).standard_normal((20_000, 3))
    points /= 2 * np.linalg.norm(points, axis=1)[:, None]
    normals = 2 * points
    true = SKIN * np.exp(0.4 * normals[:, 1:2])
    seen = (normals[:, 2] > 0.4).astype(float)
    own, other = _Mean(len(points)), _Mean(len(points))
    own.total[:, :3], own.weights[:] = seen[:, None] * true, seen
    own.best[:] = seen
    parts = tuple(np.full(len(points), float(kind == 2)) for kind in range(4))
    skin = np.ones(len(points), bool)
    side = (np.abs(normals[:, 2]) < 0.2) & (np.abs(normals[:, 1]) > 0.7)
    off = []
    for lit in (None, Relief(normals, np.ones(len(points)))):
        found = _fill(points, own, other, parts, skin, None, lit)
        off.append(float(np.abs(found - true)[side].mean()))
    assert off[1] < 0.3 * off[0]


def test_clothes_that_are_not_known_are_no_light_on_skin():
    # A ball of skin over dark shoulders, which face up; the front is seen.
    random = np.random.default_rng(0).standard_normal((20_000, 3))
    normals = random / np.linalg.norm(random, axis=1)[:, None]
    head = np.arange(len(normals)) % 2 == 0
    normals[~head, 1] = np.abs(normals[~head, 1])
    points = np.where(head[:, None], 0.4 * normals, 0.6 * normals - [0, 1, 0])
    true = np.where(head[:, None], SKIN, 0.05)
    seen = (normals[:, 2] > 0.2).astype(float)
    own, other = _Mean(len(points)), _Mean(len(points))
    own.total[:, :3], own.weights[:] = seen[:, None] * true, seen
    own.best[:] = seen
    parts = tuple(np.full(len(points), float(kind == 2)) for kind in range(4))
    lit, plain = (_fill(points, own, other, parts, head, None, relief) for relief in (
        Relief(normals, np.ones(len(points))), None))
    assert np.abs(lit - true)[head].max() < 0.01
    assert np.abs(lit - plain)[~head].max() < 0.01


def test_what_is_finer_than_a_lattice_makes_no_dots():
    camera = Camera.arc(np.zeros(1), distance=4.0, width=64, height=64, focal=160.0)
    pattern = np.indices((64, 64)).sum(axis=0) % 2
    shot = Shot.of(camera, np.repeat(pattern[..., None], 3, axis=2).astype(np.float32), None)
    unit = 40.0  # pixels
    coarse = shot.as_fine_as(5 / unit).colors
    assert np.ptp(coarse[8:-8, 8:-8]) < 0.05 and abs(coarse[8:-8, 8:-8].mean() - 0.5) < 0.01
    assert np.array_equal(shot.as_fine_as(1 / unit).colors, shot.colors)


def test_what_is_not_seen_is_as_uneven_as_what_is():
    points = np.random.default_rng(0).standard_normal((40_000, 3))
    points /= 2 * np.linalg.norm(points, axis=1)[:, None]
    seen = points[:, 2] > 0
    spread = []
    for strength in (0.0, 0.1):
        noise = np.random.default_rng(1).standard_normal((40_000, 1))
        # A dark mouth is no grain.
        mouth = np.ones(len(points))
        mouth[(np.abs(points[:, 0]) < 0.1) & (np.abs(points[:, 1]) < 0.05)] = 0.2
        colors = SKIN * np.exp(strength * noise) * mouth[:, None]
        grain = _grain(points, 2 * points, colors, seen.astype(float), ~seen, (1.0,))
        spread.append(float(np.log(grain).std()))
    assert spread[0] < 0.02 and 0.06 < spread[1] < 0.15


def test_a_hue_is_held_and_its_lightness_kept():
    generator = np.random.default_rng(4)
    # It is redder in shade, as skin is.
    light = generator.uniform(0.3, 1.0, (3000, 1))
    skin = SKIN * light * np.exp(0.1 * (1 - light) * [1, 0, -1])
    skin *= np.exp(generator.normal(0, 0.02, skin.shape))
    hue = Hue.of(skin, np.ones(len(skin)))
    assert hue is not None
    assert np.abs(np.log(hue.held(skin) / skin)).mean() < 0.02
    stained = skin * np.array([0.8, 1.1, 0.7])
    held = hue.held(stained)
    assert np.allclose(held @ LUMINANCE, stained @ LUMINANCE, atol=1e-6)
    off = [np.abs(np.log(one[:, 0] / one[:, 1] / (skin[:, 0] / skin[:, 1]))).mean()
           for one in (stained, held)]
    assert off[0] > 0.3 and off[1] < 0.08
    assert Hue.of(skin[:20], np.ones(20)) is None


@pytest.mark.parametrize("worn", [True, False])
def test_a_colored_light_along_one_cheek_is_no_stain_on_the_other(worn):
    x, y = (one.ravel() for one in np.meshgrid(np.linspace(-0.6, 0.6, 60), np.linspace(0, 1, 40)))
    points = np.stack([x, y, -x ** 2], axis=1)
    normals = np.stack([x, np.zeros_like(x), np.ones_like(x)], axis=1)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    skin = np.ones(len(points), bool)
    colors = np.broadcast_to(SKIN, (len(points), 3)).copy()
    colors[x > 0.45] *= [0.75, 1.0, 0.6]  # green
    own, other = _Mean(len(points)), _Mean(len(points))
    for mean, way in ((own, 1), (other, -1)):
        mean.weights[:] = mean.best[:] = way * x > -0.2
        slanted = np.clip(1.2 - 1.5 * np.abs(x), 0.3, 1)
        mean.square[:] = mean.best * slanted ** LIT
        mean.total[:, :3] = mean.best[:, None] * (colors if way > 0 else colors.reshape(
            40, 60, 3)[:, ::-1].reshape(-1, 3))
    bare, none = np.ones(len(points)), np.zeros(len(points))
    ring = np.zeros((len(points), 2)) if worn else None
    found = _fill(points, own, other, (none, none, bare, none), skin, ring,
                  Relief(normals, np.ones(len(points))))
    redness = found[:, 0] / found[:, 1]
    assert redness[x < -0.45].min() > 0.95 * SKIN[0] / SKIN[1]
