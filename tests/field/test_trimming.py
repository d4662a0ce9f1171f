"""Frayed busts get a clean lower end; others are left alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from lfportrait.capture import Camera, Capture
from lfportrait.field import VoxelField
from lfportrait.field.grid import Cut
from lfportrait.field.trimming import above_wall, find_cut, kept_pixels, trim
from tests.fields import head_field
from tests.portraits import HEAD_LANDMARKS

SIZE = 64
VOXEL = 2 / SIZE
END = -0.97
RAGS = 16.0
FACE = HEAD_LANDMARKS + np.array([0.0, 0.25, 0.0])
CRUMB = np.array([0.75, 0.75, 0.0])


def bust(fray, lean=0.0, seed=0, crumb=False):
    """The head of the tests; its end frays by so many voxels, and leans."""
    head = head_field(SIZE)
    links = np.arange(SIZE ** 3, dtype=np.int32).reshape((SIZE,) * 3)
    full = VoxelField(links, np.zeros(SIZE ** 3, np.float32),
                      np.zeros((SIZE ** 3, 3, 1), np.float32))
    points = full.lattice_points()
    there = head.links.ravel() >= 0
    full.density[there], full.sh[there] = (values[head.links.ravel()[there]]
                                           for values in (head.density, head.sh))
    angle = np.arctan2(points[:, 2], points[:, 0])
    rags = np.random.default_rng(seed).uniform(0, 1, 48)
    rag = rags[((angle / (2 * np.pi) + 0.5) * 48).astype(int) % 48]
    full.density[points[:, 1] < END + lean * points[:, 0] + fray * VOXEL * rag] = 0
    if crumb:
        full.density[np.linalg.norm(points - CRUMB, axis=1) < 2.2 * VOXEL] = 80
    return full


def photos(low, count=9):
    """Cameras far away on an arc, whose pictures end below at the height ``low``."""
    side, half = 100, 0.5 * (1.3 - low)
    return Camera.arc(np.linspace(-60, 60, count), distance=40.0, width=side, height=side,
                      focal=40.0 * 0.5 * side / half, target=(0.0, low + half, 0.0))


ALL = photos(-1.1)


def surface(field):
    return field.lattice_points()[field.density > 8]


def test_an_even_end_is_left_alone():
    assert find_cut(bust(0.0), FACE, ALL) is None
    assert find_cut(bust(1.5), FACE, ALL) is None


@settings(max_examples=8, deadline=None)
@given(some.integers(0, 10 ** 6), some.floats(-0.08, 0.08))
def test_rags_are_cut_off_and_nothing_else(seed, lean):
    field = bust(RAGS, lean, seed)
    cut = find_cut(field, FACE, ALL)
    assert cut is not None and cut.normal[1] > 0.97
    # Not far above the rags' ends, and above nearly all of them.
    assert END < cut.height < END + (RAGS + 2) * VOXEL
    done = trim(field, cut)
    assert cut.above(surface(done)).min() > -VOXEL
    kept = cut.above(surface(field)) > 4 * VOXEL
    assert (cut.above(surface(done)) > 4 * VOXEL).sum() == kept.sum()
    # What is left ends evenly: there is nothing more to cut.
    assert find_cut(done, FACE, ALL) is None


def test_rows_that_stay_keep_their_values():
    field = bust(RAGS)
    rows = np.arange(len(field.density))
    field.hair, field.clothes = (np.uint8(rows % one) for one in (251, 241))
    cut = find_cut(field, FACE, ALL)
    done = trim(field, cut)
    assert len(done.density) < len(field.density)
    both = (done.links >= 0) & (field.links >= 0)
    assert (both == (done.links >= 0)).all()
    assert np.array_equal(done.sh[done.links[both]], field.sh[field.links[both]])
    places = cut.above(done.lattice_points()) > 4 * VOXEL
    mine = done.density[places]
    index = np.argwhere(done.links >= 0)
    order = done.links[done.links >= 0]
    theirs = field.density[field.links[tuple(index[np.argsort(order)].T)]][places]
    assert np.array_equal(mine, theirs)
    for name in ("hair", "clothes"):
        np.testing.assert_array_equal(getattr(done, name)[done.links[both]],
                                      getattr(field, name)[field.links[both]])


def test_pixels_that_a_cut_leaves_show_what_they_showed():
    field = bust(RAGS)
    cut = find_cut(field, FACE, ALL)
    cameras = Camera.arc(np.array([20.0]), distance=4.0, width=96, height=96, focal=150.0)
    kept = kept_pixels(field, cameras, 0, cut, trim(field, cut))
    before, after = (one.render(cameras, 0) for one in (field, trim(field, cut)))
    change = np.abs(after.color - before.color).max(axis=-1)
    assert change[kept].max() < 0.1 and change[~kept].max() > 0.5
    # The head counts, and what is empty.
    assert kept[before.alpha > 0.5].mean() > 0.6 and kept[before.alpha == 0].mean() > 0.8


def test_crumbs_go_with_the_rags():
    field = bust(RAGS, crumb=True)
    assert (np.linalg.norm(surface(field) - CRUMB, axis=1) < 3 * VOXEL).any()
    done = trim(field, find_cut(field, FACE, ALL))
    assert not (np.linalg.norm(surface(done) - CRUMB, axis=1) < 3 * VOXEL).any()
    assert len(surface(done)) > 0.6 * len(surface(field))


def test_slivers_that_hang_by_one_end_go_with_the_rags():
    field = bust(RAGS)
    cut = find_cut(field, FACE, ALL)
    points = field.lattice_points()
    above = cut.above(points) / VOXEL
    plain = trim(field, cut)
    # A sliver beside the neck, from the shoulder's edge outwards along the cut, and a clear layer.
    beside = (np.abs(points[:, 2]) < 1.5 * VOXEL) & (points[:, 0] > 0)
    field.density[beside & (above > 1.0) & (above < 3.0) & (points[:, 0] < 0.9)] = 80
    away = points[:, 0] > 0.75
    assert (field.density[away] > 8).any()
    done = trim(field, cut)
    assert not (surface(done)[:, 0] > 0.75).any()
    assert 0 <= len(surface(done)) - len(surface(plain)) < 20
    # Held-out photos do not ask for what the cut takes with it.
    cameras = Camera.arc(np.array([0.0]), distance=4.0, width=96, height=96, focal=150.0)
    alpha = [one.depth(cameras, 0)[0] for one in (field, done)]
    lost = alpha[1] < alpha[0] - 0.5
    kept = kept_pixels(field, cameras, 0, cut, done)
    assert lost.any() and not (lost & kept).any()


@pytest.mark.parametrize("landmarks", [
    FACE - [0.0, 0.5, 0.0], np.full((68, 3), np.nan)])
def test_a_face_near_the_end_and_no_face_leave_the_bust_alone(landmarks):
    assert find_cut(bust(RAGS), landmarks, ALL) is None


@pytest.mark.parametrize("fray", [0.0, RAGS])
def test_a_bust_is_cut_where_most_photos_end(fray):
    field = bust(fray)
    low, high = photos(-0.8), photos(-0.45)
    chosen = [(low, view) if view % 3 else (high, view) for view in range(9)]
    cut = find_cut(field, FACE, Camera.concatenate([cameras[view] for cameras, view in chosen]))
    assert cut is not None and cut.normal[1] > 0.99
    assert abs(cut.height + 0.8) < 0.04


def test_given_mattes_are_believed_further_down():
    field = bust(0.0)
    low, high = photos(-0.8), photos(-0.6)
    chosen = Camera.concatenate([(high if view % 3 else low)[view] for view in range(9)])
    guessed, given = find_cut(field, FACE, chosen), find_cut(field, FACE, chosen, surely=True)
    assert abs(guessed.height + 0.6) < 0.04
    assert abs(given.height + 0.8) < 0.04


SMALL_FACE = 0.5 * HEAD_LANDMARKS + np.array([0.0, 0.3, 0.0])
WALL = 0.45, 0.75, 0.35


def before_a_wall(below=-np.inf, wall=WALL, shirt=False):
    """The bust and its photos before a plain wall; mattes and field have that below a height.

    ``shirt``: a fifth of the body above has the wall's color as well.
    """
    field = bust(0.0)
    points = field.lattice_points()
    like = (points[:, 1] < below) | (shirt & (np.sin(20 * points[:, 1]) > 0.8))
    field.sh[like] = ((np.array(WALL) - 0.5) / 0.28209479177387814)[:, None]
    cameras = Camera.arc(np.linspace(-20, 20, 12), distance=4.0, width=60, height=80, focal=100.0)
    shots = [field.render(cameras, view) for view in range(12)]
    images = [(255 * (shot.color + (1 - shot.alpha[..., None]) * (np.array(wall) - 1.0))
               ).clip(0, 255).astype(np.uint8) for shot in shots]
    return field, Capture(cameras, images, [(255 * shot.alpha).astype(np.uint8) for shot in shots],
                          [f"{view}.png" for view in range(12)], np.zeros(12, bool),
                          landmarks=SMALL_FACE)


def test_a_strip_of_the_wall_under_a_bust_is_cut_off():
    field, capture = before_a_wall(-0.8)
    assert find_cut(field, SMALL_FACE, capture.cameras) is None
    cut = above_wall(field, capture, None)
    assert cut is not None and cut.normal[1] > 0.99
    assert -0.8 < cut.height < -0.8 + 3 * VOXEL
    # A cut that takes it away already stays as it is; one that leaves most of it gives way.
    higher, lower = (Cut(np.array([0.0, 1.0, 0.0]), height) for height in (-0.79, -0.94))
    assert above_wall(field, capture, higher) is higher
    assert above_wall(field, capture, lower).height == cut.height


@pytest.mark.parametrize("case", [
    {}, {"below": -0.8, "wall": (0.8, 0.8, 0.8)}, {"below": -0.8, "shirt": True},
    {"below": -0.05}], ids=["no strip", "a hem", "a shirt like the wall", "a neckline"])
def test_what_is_no_strip_of_the_wall_stays(case):
    field, capture = before_a_wall(**case)
    assert above_wall(field, capture, None) is None
