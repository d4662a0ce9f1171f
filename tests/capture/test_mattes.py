"""Mattes: edges from the photo, agreement from the views."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from lfportrait.capture import Camera, Capture, consistent_mattes, refine_matte
from lfportrait.capture.kernels import count_votes, cover_views, vote_lattice
from lfportrait.capture.mattes import guided_filter, refine_changes
from tests.reference import voting


def rows_of(cameras: Camera) -> np.ndarray:
    return np.concatenate([cameras.pose[:, :3].reshape(-1, 12), cameras.focal, cameras.center], 1)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6))
def test_voting_kernels_agree_with_their_plain_twins(seed: int) -> None:
    random = np.random.default_rng(seed)
    count, size = 5, int(random.choice([9, 16, 17]))
    # Some cameras stand inside the lattice, so that points lie behind them.
    cameras = Camera.look_at(random.normal(size=(count, 3)) * 1.7, random.normal(size=3) * 0.2,
                             width=17, height=13, focal=11.0)
    mattes = [random.uniform(0, 1, (13, 17)).astype(np.float32) for _ in range(count)]
    first, spacing = np.array([-1.0, -0.9, -1.1]), 0.23
    rows = rows_of(cameras)
    share = vote_lattice(rows, np.concatenate([matte.ravel() for matte in mattes]),
                         np.array([matte.shape for matte in mattes]), first, spacing, size,
                         np.float32(0.4))
    expected = voting.vote_lattice(rows, mattes, first, spacing, size, np.float32(0.4))
    # A point on the border of two pixels may be in either.
    assert np.count_nonzero(~np.isclose(share, expected, atol=1e-5)) <= 2
    points = random.random((size, size, size)) < 0.1
    for row in rows:
        assert np.count_nonzero(cover_views(row, points, first, spacing, 13, 17)
                                != voting.cover_views(row, points, first, spacing, 13, 17)) <= 2


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6))
def test_counted_votes_agree_with_their_plain_twin(seed: int) -> None:
    random = np.random.default_rng(seed)
    count, size = 6, tuple(int(side) for side in random.integers(3, 22, 3))
    cameras = Camera.look_at(random.normal(size=(count, 3)) * 1.7, random.normal(size=3) * 0.2,
                             width=17, height=13, focal=11.0)
    covered = [random.random((13, 17)) < 0.6 for _ in range(count)]
    first, spacing = np.array([-1.0, -0.9, -1.1]), np.array([0.23, 0.1, 0.15])
    packed = [np.packbits(picture, bitorder="little") for picture in covered]
    rows, shapes = rows_of(cameras), np.full((count, 2), [13, 17])
    z, y, x = np.meshgrid(*[np.arange(side) for side in size], indexing="ij")
    points = first + spacing * np.stack([x, y, z], -1).reshape(-1, 3)
    seen, against = np.zeros((2, len(points)))
    for row, picture in zip(rows, covered):
        shown, v, u = voting.inside(row, points, 13, 17)
        seen[shown] += 1
        against[shown] += ~picture[v, u]
    found = [part.ravel() for part in count_votes(rows, packed, shapes, first, spacing, size,
                                                  np.inf, None)]
    # A point on the border of two pixels may be in either.
    assert np.count_nonzero((found[0] != seen) | (found[1] != against)) <= 2
    # Who shows a place empty is not asked: all do.
    alone = count_votes(rows, [], shapes, first, spacing, size, np.inf, None)[0]
    assert np.array_equal(alone.ravel(), found[0])
    # With a limit only points are given up that would be found above it.
    asked = random.random(size) < 0.1
    few = [part[asked] for part in count_votes(rows, packed, shapes, first, spacing, size, 1.0,
                                               asked)]
    whole = [part.reshape(size)[asked] for part in found]
    assert np.array_equal(few[1] > 1, whole[1] > 1)
    assert np.array_equal(few[0][few[1] <= 1], whole[0][few[1] <= 1])


def photo_of(mask: np.ndarray, seed: int = 0) -> np.ndarray:
    """Skin-like shading inside the mask, a bluish texture outside, with noise."""
    random = np.random.default_rng(seed)
    columns = np.indices(mask.shape)[1]
    skin = np.array([200, 150, 125]) * (0.75 + 0.25 * columns / mask.shape[1])[..., None]
    wall = ndimage.gaussian_filter(random.uniform(0, 255, (*mask.shape, 3)), (5, 5, 0))
    wall = (wall - wall.mean()) * 6 + np.array([90, 110, 150])
    image = np.where(mask[..., None], skin, wall) + random.normal(0, 3, (*mask.shape, 3))
    return np.uint8(np.clip(ndimage.gaussian_filter(image, (0.6, 0.6, 0)), 0, 255))


def head_mask(height: int = 360, width: int = 480) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    head = ((x - 230) / 80)**2 + ((y - 150) / 105)**2 < 1
    return head | (np.hypot((x - 322) / 20, (y - 160) / 30) < 1) | (
        (y > 260) & (np.abs(x - 230) < 60 + (y - 260)))


def test_refined_mattes_follow_the_photos_edges() -> None:
    mask = head_mask()
    coarse = ndimage.zoom(ndimage.gaussian_filter(
        ndimage.zoom(mask.astype(float), 0.25, order=1), 0.8), 4, order=1)
    assert coarse.shape == mask.shape
    before = np.abs(coarse - mask).mean()
    matte = refine_matte(photo_of(mask), coarse)
    assert matte.dtype == np.float32
    assert matte.min() >= 0
    assert matte.max() <= 1
    assert np.abs(matte - mask).mean() < 0.2 * before
    # The outline is off by little more than a pixel anywhere.
    wrong = (matte > 0.5) != mask
    assert not (wrong & ~(ndimage.binary_dilation(mask, iterations=3)
                          & ~ndimage.binary_erosion(mask, iterations=3))).any()


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_refining_an_empty_or_full_matte_changes_nothing(value: float) -> None:
    matte = refine_matte(photo_of(head_mask()), np.full((360, 480), value))
    assert np.array_equal(matte, np.full((360, 480), value, np.float32))


def test_guided_filter_reproduces_what_is_linear_in_the_colors() -> None:
    random = np.random.default_rng(0)
    image = random.uniform(0, 1, (40, 50, 3)).astype(np.float32)
    plane = image @ np.array([0.3, -0.2, 0.5], np.float32) + np.float32(0.1)
    assert np.allclose(guided_filter(image, plane, 4, 1e-7), plane, atol=2e-3)
    smooth = guided_filter(image, plane, 4, 1e4)
    assert np.std(smooth) < 0.15 * np.std(plane)


def ball_capture() -> tuple[Capture, np.ndarray]:
    """A ball of radius 0.6 before textured walls, 20 views, with its true mattes [V, H, W]."""
    cameras = Camera.arc(np.linspace(-80, 80, 20), distance=4, width=160, height=120, focal=200)
    truth = []
    for view in range(len(cameras)):
        origins, directions = cameras.rays(view)
        nearest = np.linalg.norm(np.cross(origins, directions), axis=1)
        truth.append(nearest.reshape(120, 160) < 0.6)
    images = [photo_of(mask, view) for view, mask in enumerate(truth)]
    names = [f"{view}.png" for view in range(20)]
    return Capture(cameras, images, None, names, np.zeros(20, bool)), np.array(truth)


def test_views_vote_patches_away_and_holes_full() -> None:
    capture, truth = ball_capture()
    given_mattes = truth.astype(np.float32).copy()
    given_mattes[3, 5:30, 10:40] = 1  # a piece of wall that one view takes for the person
    given_mattes[8, 50:62, 75:90] = 0  # and a hole in the person
    result = consistent_mattes(capture, list(given_mattes), size=96)
    for view, matte in enumerate(result):
        wrong = np.abs(matte - truth[view]) > 0.5
        assert wrong.mean() < 0.004, view
    assert result[3][5:30, 10:40].max() < 0.05
    assert result[8][53:59, 78:87].min() > 0.95


def test_right_mattes_stay_as_they_are() -> None:
    capture, truth = ball_capture()
    result = consistent_mattes(capture, list(truth.astype(np.float32)), size=96)
    assert np.abs(np.array(result) - truth).mean() < 0.003


def test_a_person_cut_by_the_picture_keeps_what_few_views_show() -> None:
    capture, truth = ball_capture()
    mattes = truth.astype(np.float32)
    # One camera turned down shows more of the person below than all others do.
    mattes[:, 100:] = 1
    result = consistent_mattes(capture, list(mattes), size=96)
    assert np.mean([matte[118, 60:100].mean() for matte in result]) > 0.9


def test_few_views_are_left_alone() -> None:
    capture, _ = ball_capture()
    few = Capture(capture.cameras[:4], capture.images[:4], None, capture.names[:4],
                  np.zeros(4, bool))
    mattes = [np.random.default_rng(0).uniform(0, 1, (120, 160)) for _ in range(4)]
    assert np.allclose(consistent_mattes(few, mattes), mattes, atol=1e-6)


def test_only_what_changed_is_laid_along_the_edges():
    mask = head_mask()
    sharp = np.float32(mask)
    photo = photo_of(mask)
    assert refine_changes(photo, sharp, sharp) is sharp
    changed = sharp.copy()
    rows, columns = np.nonzero(mask)
    edge = rows.argmin()  # a bite out of the crown
    changed[rows[edge]:rows[edge] + 6, columns[edge] - 6:columns[edge] + 6] = 0.0
    result = refine_changes(photo, sharp, changed)
    assert result.shape == mask.shape and result.min() >= 0 and result.max() <= 1
    assert np.array_equal(result[rows[edge] + 60:], changed[rows[edge] + 60:])
    assert np.abs(result - sharp).mean() < np.abs(changed - sharp).mean()
