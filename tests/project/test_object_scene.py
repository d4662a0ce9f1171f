"""The script that renders objects and a room for radiance fields."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numba import njit
from scipy.ndimage import binary_erosion
from scipy.spatial import cKDTree

import make_object_scene as script
from lfportrait.capture import Capture
from lfportrait.media.pictures import read_image
from object_scenes import DISTANCE, KINDS, Design, Scene
from object_scenes.grid import march
from object_scenes.materials import material
from object_scenes.solids import BOX, CLOTH, LATHE, SPINDLE, Model, distance, radius_at, wave

SIZE = 32
pytestmark = pytest.mark.slow  # nothing that users run: its kernels take ten seconds to compile


@cache
def scene_of(kind):
    """A coarse grid is baked sooner; what it lists is as exact."""
    return Scene(replace(KINDS[kind](), cells=64))


@cache
def picture_of(kind):
    scene = scene_of(kind)
    return scene.picture(scene.cameras(4, SIZE, 0).pose[0], SIZE)


def test_the_object_is_where_its_cameras_look(tmp_path):
    script.make(tmp_path, size=48, train=2, test=1)
    for name in ("train/r_0", "train/r_1", "test/r_0"):
        alpha = read_image(tmp_path / f"{name}.png")[..., 3]
        assert 0.1 < (alpha == 255).mean() < 0.6 and (alpha == 0).mean() > 0.3
        assert 0.01 < ((alpha > 0) & (alpha < 255)).mean() < 0.2  # edges are smooth
    capture = Capture.load(tmp_path)
    assert list(capture.held_out) == [False, False, True]
    # Cameras stand on a sphere about the origin, whose z is up, and look at it.
    back = np.linalg.inv(capture.frame)
    position = capture.cameras.position @ back[:3, :3].T + back[:3, 3]
    np.testing.assert_allclose(np.linalg.norm(position, axis=1), DISTANCE)
    assert (position[:, 2] > 0).all()
    pixels, _ = capture.cameras.project((capture.frame[:3, 3])[None])
    np.testing.assert_allclose(pixels, 24.0, atol=1e-6)
    # What stands on the plate hides what lies behind: seen from elsewhere, the roof's color stays.
    roof = capture.frame[:3, :3] @ (0.9 * np.array([-0.25, 0.0, 0.47]) + (0, 0, 0.13))
    pixels, _ = capture.cameras.project((roof + capture.frame[:3, 3])[None])
    for view, (x, y) in enumerate(pixels[:, 0]):
        red, green, blue = capture.images[view][int(y), int(x)].astype(int)
        assert red > 100 and red > green > 2 * blue


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_has_something_in_the_middle_of_its_pictures(kind):
    picture, scene = picture_of(kind), scene_of(kind)
    solid = picture[..., 3] == 255
    if scene.design.closed:
        assert solid.all()
    else:
        assert 0.1 < solid.mean() < 0.6
        rim = np.concatenate([picture[0, :, 3], picture[:, 0, 3], picture[:, -1, 3]])
        assert (rim == 0).mean() > 0.9
    assert picture[solid][:, :3].std(axis=0).min() > 15
    views, near = scene.cameras(12, SIZE, 1), 0
    for pose in views.pose:
        t = march(scene.baked, pose[:3, 3].copy(), pose[:3, 2].copy(), scene.design.start, 1e9, 0.0,
                  False)[0]
        near += t > 0 and np.linalg.norm(pose[:3, 3] + t * pose[:3, 2]) < 1.1
    assert near >= 9


def test_kinds_differ():
    pictures = [picture_of(kind).astype(int) for kind in KINDS]
    for number, first in enumerate(pictures):
        for second in pictures[number + 1:]:
            assert np.abs(first - second)[..., :3].mean() > 12


@njit(cache=True)
def least_distances(solids, numbers, profiles, points):
    out = np.full(len(points), 1e9)
    for i in range(len(points)):
        for s in numbers:
            out[i] = min(out[i], distance(solids, s, profiles, points[i, 0], points[i, 1],
                                          points[i, 2]))
    return out


@pytest.mark.parametrize("kind", ["foliage", "room"])
def test_a_cell_lists_all_that_may_be_nearest_in_it(kind):
    baked = scene_of(kind).baked
    cells, random = len(baked.grid), np.random.default_rng(0)
    width = 2 * baked.extent / cells
    crowded = np.argsort(np.diff(baked.starts))[-40:]  # the longest lists
    for cell in [*crowded, *random.choice(np.flatnonzero(np.diff(baked.starts)), 40)]:
        corner = np.array(np.unravel_index(cell, (cells,) * 3)) * width - baked.extent
        points = corner + width * random.uniform(size=(20, 3))
        # As the scene's own loops count: for others all distances would be compiled once more.
        listed = baked.listed[baked.starts[cell]:baked.starts[cell + 1]].astype(np.int64)
        np.testing.assert_array_equal(
            least_distances(baked.solids, listed, baked.profiles, points),
            least_distances(baked.solids, np.arange(len(baked.solids)), baked.profiles, points))


def test_the_room_is_read_as_photos_without_mattes(tmp_path, monkeypatch):
    monkeypatch.setitem(script.KINDS, "room", lambda: scene_of("room").design)
    script.make(tmp_path, size=24, train=2, test=1, kind="room")
    capture = Capture.load(tmp_path)
    assert capture.alphas is None and capture.images[0].shape == (24, 24, 3)
    assert list(capture.held_out) == [False, False, True]


def pane(*behind):
    """A pane of red glass, 0.04 thick and upright, and what stands behind it."""
    model = Model()
    model.add(BOX, (0, 0, 0), (0.02, 0.5, 0.5), 0, 0.0)
    for place in behind:
        model.ball(place, 0.3, 1)
    rows, profiles = model.arrays()
    return Scene(Design(rows, profiles, np.array([material((1.0, 0.5, 0.25), clear=30.0),
                                                  material((0.7, 0.7, 0.7))]), cells=32))


def test_glass_is_as_opaque_as_it_dims():
    pose = Scene.cameras(pane(), 1, SIZE, 0).look_at(
        np.array([[4.0, 0.0, 0.0]]), np.zeros(3), width=SIZE, height=SIZE, focal=40.0,
        up=(0, 0, 1)).pose[0]
    middle = pane().picture(pose, SIZE)[SIZE // 2, SIZE // 2] / 255.0
    passed = 0.95 * np.exp(-30.0 * (1 - np.array([1.0, 0.5, 0.25])) * 0.04)
    assert middle[3] == pytest.approx(1 - passed.min(), abs=0.02)
    # Over white paper it has the color that it lets through, and some that it mirrors.
    over_white = (middle[:3]**2.2 * middle[3] + 1 - middle[3])
    assert np.abs(over_white - np.minimum(passed + 0.02, 1)).max() < 0.05
    behind = pane((-0.6, 0.0, 0.0)).picture(pose, SIZE)[SIZE // 2, SIZE // 2].astype(int)
    assert behind[3] == 255 and behind[0] > behind[1] + 20 > behind[2] + 30


def test_glass_is_seen_through_inside_its_outline():
    scene = scene_of("glass")
    picture = scene.picture(scene.cameras(88, 64, 0).pose[3], 64)
    veiled = (picture[..., 3] > 10) & (picture[..., 3] < 245)
    assert binary_erosion(veiled).sum() >= 5  # an edge is one pixel wide


@pytest.mark.parametrize("wall", [0.0, 0.02])
def test_a_lathe_never_overestimates_its_distance(wall):
    model = Model()
    model.lathe((0, 0, 0), (-0.4, -0.25, 0.0, 0.2, 0.4), (0.1, 0.3, 0.12, 0.28, 0.2), 0, wall)
    rows, profiles = model.arrays()
    assert rows[0, 0] == (LATHE if wall else SPINDLE)
    half, rounding, wall = rows[0, 15], rows[0, 16], rows[0, 14] if wall else 0.0
    # The outline in a plane through the axis: the sides, and their rounded ends.
    bow = np.linspace(0, np.pi / 2, 300)
    along = np.concatenate([np.linspace(0, half - rounding, 4000),
                            half - rounding * (1 - np.sin(bow)), np.full(1500, half)])
    level = np.concatenate([along, -along])
    radius = np.array([radius_at(profiles[1], 0.5 + 0.5 * h / half) for h in level])
    off = np.concatenate([np.zeros(4000), rounding * (1 - np.cos(bow)),
                          np.linspace(rounding, wall or 0.3, 1500)])
    off = wall - np.concatenate([off, off])
    sides = [np.maximum(radius + off, 0)] if wall == 0 else [radius + off, radius - off]
    outline = np.concatenate([np.stack([side, level], 1) for side in sides])
    random = np.random.default_rng(0)
    points = np.stack([random.uniform(0, 0.6, 4000), random.uniform(-0.7, 0.7, 4000)], 1)
    points[::2] = outline[random.integers(len(outline), size=2000)] + random.normal(
        scale=0.02, size=(2000, 2))
    points[:, 0] = np.abs(points[:, 0])
    true = cKDTree(outline).query(points)[0]
    turn = random.uniform(0, 2 * np.pi, len(points))
    space = np.stack([points[:, 0] * np.cos(turn), points[:, 0] * np.sin(turn), points[:, 1]], 1)
    found = least_distances(rows, np.arange(1), profiles, space)
    assert (np.abs(found) <= true + 5e-4).all()
    outside = found > 1e-3
    assert outside.mean() > 0.5 and (found[outside] > true[outside] / rows[0, 19]**2 - 5e-4).all()


def test_a_cloth_never_overestimates_its_distance():
    model = Model()
    model.cloth((0, 0, 0), 1.0, 0.01, 0.05, 0)
    rows, profiles = model.arrays()
    assert rows[0, 0] == CLOTH
    span = np.linspace(-1, 1, 400)
    x, y = (plane.ravel() for plane in np.meshgrid(span, span))
    x, y = x[np.hypot(x, y) < 1], y[np.hypot(x, y) < 1]
    lifted = np.array([wave(p, q, 1.0, 0.05) for p, q in zip(x, y)])
    tree = cKDTree(np.concatenate([np.stack([x, y, lifted + side], 1) for side in (-0.01, 0.01)]))
    points = np.random.default_rng(0).uniform((-1, -1, -0.3), (1, 1, 0.3), (2000, 3))
    found = least_distances(rows, np.arange(1), profiles, points)
    assert (found <= tree.query(points)[0] + 3e-3).all()
    assert (found > 0).mean() > 0.7
