"""Hair that hangs down: on the body, behind the neck, and with the strands that a photo shows."""

import functools
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo.hair import grown_out
from lfportrait.face.one_photo.lattice import shell_of
from lfportrait.face.one_photo.paint import (
    BAY,
    BAY_CELL,
    HIDDEN,
    WIDTHS,
    Shot,
    _closed,
    _hairy,
    painted,
    strand_contrast,
    strands,
)
from lfportrait.face.one_photo.parts import ground_in_hair, parts_of
from lfportrait.face.one_photo.piece import BROAD, filled
from lfportrait.face.one_photo.samples import depth_maps
from lfportrait.face.one_photo.solid import HAIR, HEAD, Solid, solid_of
from lfportrait.face.one_photo.tufts import aligned, tufts
from lfportrait.field import C0

from .generic import generic_head

SIDE = 240


@functools.cache
def bust(*lengths: float) -> Solid:
    """The generic head on drawn shoulders, with hair down to two heights (left, right).

    Not to be changed.
    """
    prior = generic_prior()
    points, samples = generic_head()
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=1.75 * SIDE,
                        target=(0, -0.25, 0), pitch=0.0)

    def drawn(corners: list[tuple[float, float]]) -> np.ndarray:
        out = np.zeros((SIDE, SIDE), np.uint8)
        places = np.column_stack([np.array(corners), np.zeros(len(corners))])
        return cv2.fillPoly(out, [np.rint(camera.project(places)[0][0]).astype(np.int32)], 1)

    head = np.zeros((SIDE, SIDE), np.uint8)
    for corners in np.rint(camera.project(points)[0][0][prior.triangles]).astype(np.int32):
        cv2.fillConvexPoly(head, corners, 1)
    body = drawn([(-0.24, -0.62), (0.24, -0.62), (0.9, -0.95), (0.95, -2), (-0.95, -2),
                  (-0.9, -0.95)])
    top, wide = points[:, 1].max(), np.abs(points[:, 0]).max()
    face = drawn([(-0.3, 0.3), (0.3, 0.3), (0.3, -2), (-0.3, -2)])
    hair = np.zeros((SIDE, SIDE), np.uint8)
    for sign, end in zip((-1, 1), lengths, strict=True):
        hair |= drawn([(0, top + 0.05), (sign * (wide + 0.15), 0.5 * top),
                       (sign * (wide + 0.15), end), (0, end)])
    hair &= 1 - face
    matte = (head | body | hair).astype(np.float32)
    parts = parts_of(camera, matte, hair.astype(np.float32), 4.0)
    return solid_of(parts, samples)


@pytest.fixture(scope="module")
def long() -> Solid:
    return bust(-1.1, -1.1)


@pytest.fixture(scope="module")
def bare() -> Solid:
    """One whose hair ends above the neck."""
    return bust(-0.2, -0.2)


def ends(solid: Solid, x: float, y: float) -> tuple[float, float, int]:
    """How far in front and behind the solid reaches on a line, and whose its back is."""
    z = np.linspace(-1.5, 1.5, 601)
    away, owner = solid.distance(np.column_stack([np.full(601, x), np.full(601, y), z]), 0.3)
    inside = np.flatnonzero(away < 0)
    return float(z[inside[-1]]), float(z[inside[0]]), int(owner[inside[0]])


def test_the_back_of_a_neck_has_hair_if_it_hangs_down_on_both_sides(long, bare):
    for height in (-0.3, -0.5, -0.7, -0.9):
        assert ends(long, 0.0, height)[2] == HAIR, height
    assert ends(bare, 0.0, -0.6)[2] != HAIR


@pytest.mark.slow  # a bust of its own
def test_hair_on_one_side_ends_behind_in_a_slope():
    one = bust(-1.1, -0.2)
    assert ends(one, -0.45, -0.85)[2] == HAIR
    assert ends(one, 0.3, -0.85)[2] != HAIR


def test_hair_lies_on_the_chest(long, bare):
    for height in (-0.9, -1.0):
        before, skin = ends(long, 0.42, height)[0], ends(bare, 0.42, height)[0]
        assert skin - 0.12 < before < skin + 0.17, height


@pytest.mark.parametrize("x", [-0.5, *(
    pytest.param(x, marks=pytest.mark.slow) for x in (-0.42, 0.42, 0.5))])
def test_hair_beside_a_face_falls_straight(long, x):
    # Neither towards the mouth, where a jaw's middle is, nor back to the neck at once.
    front = np.array([ends(long, x, y)[0] for y in np.arange(0.2, -0.95, -0.1)])
    assert np.diff(front).max() < 0.05
    assert np.diff(front).min() > -0.11


def test_no_shoulder_is_seen_where_hair_alone_hangs_down(long):
    x, y = np.meshgrid(np.linspace(-0.7, 0.7, 57), np.linspace(-0.7, -0.62, 9))
    z = np.linspace(-1.2, 1.2, 97)
    points = np.stack([*(np.repeat(part.ravel(), 97) for part in (x, y)), np.tile(z, x.size)], 1)
    away, owner = long.distance(points, 0.3)
    beside = (np.abs(points[:, 0]) > 0.45) & (away < 0)
    assert beside.sum() > 20 and (owner[beside] == HAIR).all()


@pytest.mark.slow  # paints a head
def test_short_hair_that_no_photo_shows_is_no_smooth_dome(bare):
    shell, parts = shell_of(bare, 48), bare.parts
    noise = np.random.default_rng(0).standard_normal((*parts.hair.shape, 1))
    spread = []
    for strength in (0.0, 0.2):
        colors = np.asarray(0.4 * np.exp(strength * noise) * np.ones(3), np.float32)
        sh = painted(shell, [Shot.of(parts.camera, colors, parts.hair.astype(np.float32))])[0]
        x, y, z = shell.on.T
        back = (np.abs(x) < 0.2) & (np.abs(y - 0.2) < 0.2) & (z < -0.4)
        spread.append(np.std(np.log(0.5 + C0 * sh[back].mean(axis=1))))
    assert back.sum() > 50
    assert spread[0] < 0.01 and 0.05 < spread[1] < 0.3


@pytest.mark.slow  # paints a head
def test_where_photos_differ_the_first_one_that_sees_a_place_decides(bare):
    shell, camera, size = shell_of(bare, 48), bare.parts.camera, bare.parts.hair.shape
    hair = bare.parts.hair.astype(np.float32)
    plain = np.full((*size, 3), 0.4, np.float32)
    # A lattice holds what is as coarse as it is.
    noise = np.random.default_rng(0).random((size[0] // 6 + 1, size[1] // 6 + 1, 1))
    noise = noise.repeat(6, axis=0).repeat(6, axis=1)[:size[0], :size[1]]
    x, y, z = shell.on.T
    front = (np.abs(x) < 0.3) & (np.abs(y) < 0.4) & (z > 0.2)
    spread = {}
    for kind, other in (("another", plain + np.float32(0.8) * (noise - 0.5)),
                        ("nearly alike", plain + np.float32(0.08) * (noise - 0.5))):
        shots = [Shot.of(camera, np.asarray(one, np.float32), hair) for one in (plain, other)]
        sh = painted(shell, shots)[0]
        spread[kind] = float(np.std(C0 * sh[front]) / np.std(other))
    assert front.sum() > 100
    assert spread["another"] < 0.05 and spread["nearly alike"] > 0.2


@pytest.mark.slow  # paints a head
def test_a_head_knows_its_hair_whatever_its_color(long):
    shell, parts = shell_of(long, 64), long.parts
    fair = np.full((*parts.hair.shape, 3), 0.7, np.float32)
    sh, hair, _ = painted(shell, [Shot.of(parts.camera, fair, parts.hair.astype(np.float32))])
    assert sh.shape == (len(shell.points), 3, 1) and hair is not None
    x, y, z = shell.points.T
    surface = (shell.away > -0.4 * shell.voxel) & (shell.away < shell.voxel)
    nape = surface & (np.abs(x) < 0.1) & (np.abs(y + 0.6) < 0.1) & (z < -0.2)
    assert nape.sum() > 10 and (hair[nape] == 255).all()
    locks = surface & (np.abs(np.abs(x) - 0.5) < 0.03) & (np.abs(y + 0.5) < 0.2) & (z > 0)
    assert locks.sum() > 10 and np.median(hair[locks]) > 250
    face = surface & (np.abs(x) < 0.2) & (np.abs(y) < 0.2) & (z > 0.3)
    assert face.sum() > 10 and (hair[face] == 0).all()
    shell.owner[:] = HEAD
    shell.scalp[:] = False
    assert not painted(shell, [Shot(parts.camera, fair)]).hair.any(), "a bald head is known"


def test_hair_fades_into_skin_where_a_photo_says_less_and_less():
    shell = SimpleNamespace(owner=np.array([HAIR, *[HEAD] * 6]),
                            scalp=np.array([False, *[True] * 5, False]),
                            face=np.ones(7, bool), light=np.full(7, 0.9),
                            on=np.arange(7.0)[:, None] * [0.3, 0, 0], voxel=0.01,
                            away=np.zeros(7))
    own = SimpleNamespace(best=np.array([1, 0, HIDDEN / 2, 1, 1, 1, 0]),
                          share=np.array([0, 0, 0, 0, 0.5, 1, 0]), square=np.zeros(7))
    unseen = SimpleNamespace(best=np.zeros(7), share=np.zeros(7))
    assert np.allclose(_hairy(shell, own, unseen), [1, 1, 0.5, 0, 0.5, 1, 0])
    bare, grown = (SimpleNamespace(best=np.ones(7), share=np.full(7, share)) for share in (0, 1))
    assert np.allclose(_hairy(shell, own, bare), [1, 0, 0, 0, 0.5, 1, 0]), "as the other side"
    assert np.allclose(_hairy(shell, own, grown), [1, 1, 0.5, 0, 0.5, 1, 1])
    shell.owner[:] = HEAD
    assert not _hairy(shell, own, grown).any(), "a shaven head"


@pytest.mark.parametrize("deep, hairy", [(-0.04, False), (0.0, True)])
def test_hair_that_lies_deep_within_skin_is_not_seen(deep, hairy):
    # A cheek that no photo shows, and something of hair's, in it or on it.
    cheek = np.arange(60.0)[:, None] * [0.01, 0, 0]
    shell = SimpleNamespace(owner=np.repeat([HEAD, HAIR], [60, 20]), scalp=np.zeros(80, bool),
                            face=np.ones(80, bool), light=np.ones(80), voxel=0.01,
                            on=np.concatenate([cheek, cheek[:20]]),
                            away=np.repeat([0.0, deep], [60, 20]))
    unseen = SimpleNamespace(best=np.zeros(80), share=np.zeros(80), square=np.zeros(80))
    found = _hairy(shell, unseen, unseen)[:60]
    assert found[40:].max() == 0
    assert (found[:15].min() > 0.9) == hairy and (found[:15].max() > 0.1) == hairy


@pytest.mark.parametrize("share, square, hairy", [(0.0, 1.0, False), (1.0, 1.0, True),
                                                  (0.0, 0.1, True)])
def test_the_edge_of_hair_on_a_bare_forehead_is_no_dark_line(share, square, hairy):
    # A forehead, above it its uppermost part, which is the hair's, and between them a ledge.
    count = 40
    at = np.arange(3 * count) * 0.004
    shell = SimpleNamespace(owner=np.repeat([HEAD, HAIR, HAIR], count), away=np.zeros(3 * count),
                            scalp=np.zeros(3 * count, bool), voxel=0.004,
                            face=np.repeat([True, False, False], count),
                            light=np.ones(3 * count), on=at[:, None] * [0, 1, 0])
    ledge = slice(count, count + 4)
    best = np.ones(3 * count)
    best[ledge] = 0
    shown = np.where(np.arange(3 * count) < 2 * count, share, 1.0)
    own = SimpleNamespace(best=best, share=shown * (shell.owner == HAIR), square=square * best)
    other = SimpleNamespace(best=np.zeros(3 * count), share=np.zeros(3 * count))
    found = _hairy(shell, own, other)
    assert (found[ledge] > 0.9).all() if hairy else (found[ledge] < 0.3).all()
    assert found[2 * count + 10:].min() > 0.9


def test_ground_in_hair_is_found_and_highlights_are_not():
    image = np.full((200, 200, 3), (60, 90, 200), np.uint8)
    hair = np.zeros((200, 200), np.float32)
    hair[40:160, 60:140] = 1
    image[hair > 0] = (70, 45, 30)
    image[80:100, 62:66] = (60, 92, 196)  # a gap between curls
    image[80:100, 130:134] = (150, 115, 90)  # a highlight
    found = ground_in_hair(image, hair, hair, 20.0)
    assert found[80:100, 62:66].all()
    found[80:100, 62:66] = False
    assert not found.any()
    assert not ground_in_hair(image, hair, np.zeros_like(hair), 20.0).any()
    assert not ground_in_hair(image, hair, hair, 80.0).any(), "short hair is not seen through"


def test_ground_in_a_gap_that_no_network_takes_for_hair_is_found():
    image = np.full((200, 200, 3), (60, 90, 200), np.uint8)
    matte = np.zeros((200, 200), np.float32)
    matte[40:160, 40:160] = 1
    image[matte > 0] = (70, 45, 30)
    gap, face = np.s_[90:100, 70:80], np.s_[120:150, 120:150]
    image[gap], image[face] = (60, 92, 196), (60, 92, 196)
    hair = matte.copy()
    hair[gap] = hair[face] = 0
    found = ground_in_hair(image, matte, hair, 20.0)
    assert found[92:98, 72:78].all() and not found[face].any(), "a face is larger"
    assert found.sum() <= 100


def test_strands_are_as_strong_as_in_the_photo_and_run_down():
    unit, hair = 400.0, np.ones((240, 240), bool)
    across = np.arange(240)[None, :, None] / unit
    wave = 0.3 + 0.1 * np.sin(np.pi * across / WIDTHS[1]) + np.zeros((240, 1, 3))
    flat = strand_contrast(np.full((240, 240, 3), 0.3), hair, unit)
    assert np.abs(flat).max() < 1e-3
    contrast = strand_contrast(wave, hair, unit)
    assert contrast.argmax() in (0, 1) and contrast.max() > 0.1
    angle = np.linspace(-1.5, 1.5, 2000)
    ring = np.column_stack([0.5 * np.sin(angle), np.zeros(2000), -0.25 - 0.5 * np.cos(angle)])
    line = np.column_stack([np.full(2000, 0.2), np.linspace(-0.2, 0.2, 2000), np.full(2000, -0.7)])
    around, along = (np.log(strands(at, contrast)) for at in (ring, line))
    assert 0.5 * contrast.max() < around.std() < 2 * np.linalg.norm(contrast)
    rough = [np.abs(np.diff(values)).mean() for values in (around / 1.5, along / 0.4)]
    assert rough[0] > 2 * rough[1]
    assert (strands(ring, np.zeros(len(WIDTHS))) == 1).all()


def test_short_hair_is_as_uneven_as_in_the_photo_and_lies_away_from_the_whorl():
    side = np.linspace(-0.3, 0.3, 120)
    across, down = np.meshgrid(side, side)
    points = np.stack([across.ravel(), down.ravel() - 0.5, np.full(14400, -0.6)], axis=1)
    normals = np.broadcast_to([0.0, 0, -1], points.shape)
    contrast = np.array([0.0, 0.1, 0, 0])
    long, round_ = (np.log(tufts(points, normals, WIDTHS, contrast, one)) for one in (0.8, 0.2))
    for found in (long, round_):
        assert found.std() == pytest.approx(0.1, rel=0.1)
        assert abs(np.corrcoef(found[:7200], found[7200:])[0, 1]) < 0.5, "no repeats"
    rough = [[np.abs(np.diff(found.reshape(120, 120), axis=axis)).mean() for axis in (1, 0)]
             for found in (long, round_)]
    assert rough[0][0] > 1.6 * rough[0][1], "down"
    assert rough[1][0] < 1.3 * rough[1][1]
    assert (tufts(points, normals, WIDTHS, np.zeros(4), 0.8) == 1).all()


def test_a_few_places_have_no_tufts():
    points = np.random.default_rng(1).uniform(0.5, 0.501, (50, 3))
    ahead = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    factors = tufts(points, ahead, (0.02, 0.04, 0.08, 0.16), np.full(4, 0.2), 1.0)
    assert (factors == 1).all()


def test_hair_in_a_photo_has_a_direction_or_none():
    unit, hair = 400.0, np.zeros((240, 240), bool)
    hair[20:200, 30:220] = True
    noise = np.random.default_rng(0).standard_normal((240, 240))
    waves = [cv2.GaussianBlur(noise, (0, 0), 1.0, sigmaY=y) for y in (8.0, 1.0)]
    combed, cropped = (aligned(np.repeat((0.3 + 0.05 * wave / wave.std())[..., None], 3, axis=2),
                               hair, unit, WIDTHS[0]) for wave in waves)
    assert combed > 0.6 and cropped < 0.35


def test_what_is_filled_far_from_a_small_head_is_as_by_whole_blurs(monkeypatch):
    values = np.full((260, 200), np.nan)
    values[90:150, 70:120] = 3 + np.add.outer(np.arange(60) / 60, np.arange(50) / 50)
    whole = values.copy()
    known, sums = np.isfinite(values), np.dstack([np.nan_to_num(values), np.isfinite(values)])
    sigma = 3.0
    while not known.all():
        wide = cv2.GaussianBlur(sums.astype(np.float64), (0, 0), sigma)
        fresh = ~known & (wide[..., 1] > 1e-3)
        whole[fresh] = (wide[..., 0] / np.maximum(wide[..., 1], 1e-9))[fresh]
        known, sigma = known | fresh, 2 * sigma
    blurred, blur = [], cv2.GaussianBlur

    def watched(picture, size, sigma):
        blurred.append(sigma)
        return blur(picture, size, sigma)

    monkeypatch.setattr(cv2, "GaussianBlur", watched)
    found = filled(values, 3.0)
    there = np.isfinite(values)
    assert np.array_equal(found[there], values[there])
    # Cells where next to nothing is known may take one blur more or less.
    assert np.percentile(np.abs(found - whole), 99) < 0.05
    # However far the picture goes on: of a kernel as wide as that it would take minutes.
    assert max(blurred) <= BROAD
    assert np.isfinite(filled(np.where(np.arange(90000).reshape(900, 100) < 40, 2.0, np.nan), 6.0)
                      ).all()


@pytest.mark.slow  # a bust of its own
def test_hair_stands_off_the_skull_as_far_as_its_outline():
    prior = generic_prior()
    points, samples = generic_head()
    camera = Camera.arc(np.zeros(1), distance=40.0, width=SIDE, height=SIDE, focal=17.5 * SIDE,
                        target=(0, -0.25, 0), pitch=0.0)
    head, hair = np.zeros((2, SIDE, SIDE), np.uint8)
    line = np.quantile(points[:, 1], 0.85)
    for out, off in ((head, 0.0), (hair, 0.15)):
        raised = points + np.array([0, off, 0])
        for corners in np.rint(camera.project(raised)[0][0][prior.triangles]).astype(np.int32):
            cv2.fillConvexPoly(out, corners, 1)
    height = float(camera.project(np.array([[0, line, 0.5]]))[0][0, 0, 1])
    hair[int(height):] = 0
    parts = parts_of(camera, (head | hair).astype(np.float32), hair.astype(np.float32), 40.0)
    near = depth_maps(samples, parts)[0]
    scalp = samples.rest[:, 1] > 0.19
    moved = np.linalg.norm(grown_out(parts, samples, near, scalp).points - samples.points, axis=1)
    top = samples.points[:, 1] > samples.points[:, 1].max() - 0.01
    assert moved[top & scalp].mean() == pytest.approx(0.15, abs=0.03)
    front = (samples.points[:, 2] > 0.2) & (np.abs(samples.points[:, 0]) < 0.1)
    assert moved[front & (samples.points[:, 1] < line - 0.03)].max() == 0
    rising = front & (samples.points[:, 1] > line) & (samples.points[:, 1] < line + 0.05)
    assert 0 < moved[rising].mean() < 0.1


def test_a_surface_part_loses_bays_but_not_its_shape():
    """A bay narrower than the limit is filled, a wide one and a straight border stay."""
    across, down = np.meshgrid(np.arange(0.0, 1.0, 0.004), np.arange(0.0, 1.0, 0.004))
    points = np.stack([across.ravel(), down.ravel(), np.zeros(across.size)], axis=1)
    narrow, wide = BAY, 5 * BAY
    part = (down < 0.5).ravel()
    bay = (np.abs(across - 0.2) < narrow / 2) & (down > 0.3) & (down < 0.5)
    gulf = (np.abs(across - 0.7) < wide / 2) & (down > 0.3) & (down < 0.5)
    bare = np.zeros(len(points))
    found = _closed(points, part & ~(bay | gulf).ravel(), bare)
    assert found[bay.ravel()].mean() > 0.9
    deep = (np.abs(across - 0.7) < wide / 2 - BAY) & (down > 0.3 + BAY)
    assert found[deep.ravel()].max() < 0.1
    assert found[part & ~(bay | gulf).ravel()].min() > 0.4
    assert found[(down > 0.5 + BAY_CELL * 2).ravel()].max() < 0.1
    assert (_closed(points, np.ones(len(points), bool), bare) == 1).all()


@pytest.mark.parametrize("voxel", [0.008, 0.03])
def test_hair_has_no_gap_around_an_ear_that_no_photo_shows(voxel):
    across, down = np.meshgrid(np.arange(0.0, 1.0, voxel), np.arange(0.0, 1.0, voxel))
    points = np.stack([across.ravel(), down.ravel(), np.zeros(across.size)], axis=1)
    ears = [(np.hypot(across - place, down - 0.2) < 2 * BAY).ravel() for place in (0.2, 0.8)]
    face = (down > 0.5).ravel()
    hair = ~(ears[0] | ears[1] | face)
    found = _closed(points, hair, np.where(ears[1], 0.5, 0.0), voxel)
    assert found[ears[0]].min() > 0.9, "it lies under hair"
    core = np.hypot(across - 0.8, down - 0.2).ravel() < BAY
    assert found[core].max() < 0.1, "it is seen"
    assert found[(down > 0.6).ravel()].max() < 0.1, "a face is no gap"
