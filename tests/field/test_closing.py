"""A head that is open behind is closed, smoothly; what photos saw stays."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from scipy import ndimage

from lfportrait.capture import Camera, Capture
from lfportrait.field import VoxelField
from lfportrait.field.closing import close_back, sides
from lfportrait.field.closing.photos import Photos
from lfportrait.field.closing.shell import with_shell
from lfportrait.field.geometry.chart import Chart, continued, large_pieces
from lfportrait.field.kernels.march import C0
from lfportrait.metrics import psnr
from tests.fields import head_field, shell_field
from tests.portraits import HEAD_LANDMARKS

SIZE = 64
VOXEL = 2 / SIZE


def cameras(angles, side=160):
    return Camera.arc(np.asarray(angles, float), distance=5.0, width=side, height=side,
                      focal=5.0 * side / 2.4)


def photos(angles):
    """A capture whose pictures are empty: they are not looked at."""
    found = cameras(angles)
    blank = [np.zeros((160, 160, 3), np.uint8)] * len(found)
    matte = [np.zeros((160, 160), np.uint8)] * len(found)
    return Capture(found, blank, matte, [f"{k}.png" for k in range(len(found))],
                   np.zeros(len(found), bool))


FRONT = photos(np.linspace(-62, 62, 25))


def opened(field, angle=150.0, rag=0.0):
    """The field without what lies further around than ``angle``, and without its inside."""
    points = field.lattice_points()
    around = np.degrees(np.abs(np.arctan2(points[:, 0], points[:, 2])))
    ends = angle + rag * np.random.default_rng(0).standard_normal(len(points))
    density = np.where(around < ends, field.density, 0)
    density[np.linalg.norm(points * [1, 0.6, 1], axis=1) < 0.45 - 6 * VOXEL] = 0
    return VoxelField(field.links, density.astype(np.float32), field.sh)


# Without rags it is easier.
@pytest.mark.parametrize("angle, rag, side", [
    (150.0, 8.0, 62), (128.0, 3.0, 40), pytest.param(150.0, 0.0, 62, marks=pytest.mark.slow)])
def test_an_open_back_is_closed_where_it_was(angle, rag, side):
    whole = head_field(SIZE)
    field = opened(whole, angle, rag)
    closed, told = close_back(field, HEAD_LANDMARKS, photos(np.linspace(-side, side, 25)))
    assert told is not None and 0.01 < told.share < 0.5
    behind = cameras([150, 180, 210])
    for view in range(3):
        truth, before, after = (one.render(behind, view) for one in (whole, field, closed))
        inside = truth.alpha > 0.99
        inside[125:] = False  # the lower end is open in the truth, too
        assert (after.alpha[inside] > 0.9).mean() > 0.98
        # Through the gap one looks onto the face's inside, or past it all.
        wrong = [inside & ~np.isclose(one.depth, truth.depth, rtol=0, atol=4.5 * VOXEL)
                 for one in (before, after)]
        assert wrong[1].sum() < 0.03 * inside.sum()
        if view == 1:
            assert wrong[0].sum() > 0.1 * inside.sum()
            gap = wrong[0] & ~wrong[1]
            assert np.abs(after.depth[gap] - truth.depth[gap]).mean() < 2 * VOXEL
            assert psnr(after.color, truth.color) > psnr(before.color, truth.color) + 1


def test_photos_see_what_they_saw():
    field = opened(head_field(SIZE), rag=8.0)
    closed, _ = close_back(field, HEAD_LANDMARKS, FRONT)
    for view in range(0, 25, 4):
        before, after = (one.render(FRONT.cameras, view).color for one in (field, closed))
        assert psnr(after, before) > 36


@pytest.mark.parametrize(("count", "alone"), [(9, True), (25, False)])
def test_one_of_few_photos_sees_past_a_place_alone(count, alone):
    field = opened(head_field(SIZE))
    capture = photos(np.linspace(-62, 62, count))
    views = [Photos(field, replace(capture, held_out=np.arange(count) != view))
             for view in range(count)]
    points = np.random.default_rng(0).uniform(-1, 1, (20_000, 3))
    votes = sum(one.past(points).astype(int) for one in views)
    known = Photos(field, capture)
    assert (votes == 1).sum() > 20
    # A pixel is as wide as a voxel whichever photos are asked.
    assert (known.past(points)[votes == 1] == alone).mean() > 0.95
    assert known.past(points)[votes > 2].mean() > 0.99 and not known.past(points)[votes == 0].any()


def test_one_photo_with_a_notch_makes_no_hole(monkeypatch):
    class Notched(Photos):
        def __init__(self, field, capture):
            super().__init__(field, capture)
            for depths in (self._depths, self._last):
                depths[0][60:80] = np.inf

    field = opened(head_field(SIZE))
    behind = cameras([150, 180, 210])
    whole, _ = close_back(field, HEAD_LANDMARKS, FRONT)
    monkeypatch.setattr(sides, "Photos", Notched)
    closed, _ = close_back(field, HEAD_LANDMARKS, FRONT)
    for view in range(3):
        found, wanted = (one.render(behind, view) for one in (closed, whole))
        inside = wanted.alpha > 0.9
        assert (found.alpha[inside] > 0.9).mean() > 0.995
        assert psnr(found.color, wanted.color) > 35


class Doubtful(Photos):
    """Photos that see past a tenth of all places, and hardly see what they see."""

    def past(self, points, nearly=True):
        return super().past(points, nearly) | (np.random.default_rng(0).random(len(points)) < 0.1)

    def seen(self, points, outwards=None, least=0.0):
        return np.full(len(points), 2 if outwards is None else 0, np.int32)


def discolored(monkeypatch, field, **change):
    """How much of an orange head, closed by doubtful photos, is of another color from behind."""
    def doubtful(field, shell, _, cut):
        return with_shell(field, replace(shell, **change), Doubtful(field, FRONT), cut)

    monkeypatch.setattr(sides, "with_shell", doubtful)
    sh = np.zeros_like(field.sh)
    sh[..., 0] = (np.array([0.9, 0.5, 0.1]) - 0.5) / C0
    field = replace(field, sh=sh)
    if change:  # gray where photos look along the surface
        points = field.lattice_points()
        field.sh[np.degrees(np.abs(np.arctan2(points[:, 0], points[:, 2]))) > 135] = 0
    closed, _ = close_back(field, HEAD_LANDMARKS, FRONT)
    seen = closed.render(cameras([180]), 0)
    inside = ndimage.binary_erosion(seen.alpha > 0.95, np.ones((5, 5)))
    inside[110:] = False
    off = np.abs(seen.color[inside] / seen.alpha[inside, None] - [0.9, 0.5, 0.1]).max(axis=1)
    assert len(off) > 1000
    return float((off > 0.1).mean())


def test_no_gray_is_seen_beside_points_that_photos_see_past(monkeypatch):
    field = opened(head_field(SIZE))
    matter = (field.links >= 0) & (field.density[field.links] > 0)
    near = (field.links >= 0) & ndimage.binary_dilation(matter, np.ones((3, 3, 3)))
    links = np.full_like(field.links, -1)
    links[near] = np.arange(near.sum())
    rows = field.links[near]
    field = VoxelField(links, field.density[rows], field.sh[rows])
    assert discolored(monkeypatch, field) < 0.01


def test_colors_that_photos_hardly_see_are_not_kept(monkeypatch):
    assert discolored(monkeypatch, opened(head_field(SIZE), rag=8.0), guessed=True) < 0.06


def test_a_head_seen_from_all_sides_is_left_alone():
    field = opened(head_field(SIZE))
    same, told = close_back(field, HEAD_LANDMARKS, photos(np.arange(0, 360, 15)))
    assert same is field and told is None


def test_a_closed_head_is_left_alone():
    # Photos from the side and a little behind see the back, at an angle.
    field = head_field(SIZE)
    same, told = close_back(field, HEAD_LANDMARKS, photos(np.linspace(-125, 125, 41)))
    assert same is field and told is None


def test_left_and_right_do_not_matter():
    field = opened(head_field(SIZE), 140.0)
    mirrored = VoxelField(np.ascontiguousarray(field.links[:, :, ::-1]), field.density, field.sh)
    one, told = close_back(field, HEAD_LANDMARKS, FRONT)
    other, again = close_back(mirrored, HEAD_LANDMARKS, FRONT)
    assert told.share == pytest.approx(again.share, rel=0.02)
    behind = cameras([160, 200])
    first = one.render(behind, 0).color
    assert psnr(other.render(behind, 1).color[:, ::-1], first) > 35


def test_the_box_grows_with_the_head():
    # A lattice that ends where the photos' matter does.
    field = opened(head_field(SIZE), 130.0)
    filled = np.nonzero((field.links >= 0) & (field.density[field.links] > 0))
    first = int(filled[0].min())
    cropped = VoxelField(np.ascontiguousarray(field.links[first:]), field.density, field.sh,
                         field.center + np.array([0, 0, first * VOXEL / 2]),
                         field.radius - np.array([0, 0, first * VOXEL / 2]))
    keep = np.unique(cropped.links[cropped.links >= 0])
    links = cropped.links.copy()
    links[links >= 0] = np.searchsorted(keep, links[links >= 0])
    cropped = VoxelField(links.astype(np.int32), field.density[keep], field.sh[keep],
                         cropped.center, cropped.radius)
    one, _ = close_back(field, HEAD_LANDMARKS, FRONT)
    other, _ = close_back(cropped, HEAD_LANDMARKS, FRONT)
    behind = cameras([180])
    assert psnr(other.render(behind, 0).color, one.render(behind, 0).color) > 40


@settings(max_examples=15, deadline=None)
@given(some.integers(0, 10 ** 6), some.floats(0.05, 2.0), some.floats(-1.5, 1.5))
def test_whatever_the_face_and_the_field_it_ends_well(seed, size, height):
    field = shell_field(32, basis=1, seed=seed)
    landmarks = HEAD_LANDMARKS * size + np.array([0.0, height, 0.0])
    closed, told = close_back(field, landmarks, FRONT)
    assert (closed is field) == (told is None)
    rows = np.sort(closed.links[closed.links >= 0])
    assert np.array_equal(rows, np.arange(len(closed.density)))
    assert np.isfinite(closed.density).all() and np.isfinite(closed.sh).all()


def test_photos_face_what_they_see_squarely_and_no_rim():
    field = head_field(SIZE)
    found = Photos(field, photos(np.linspace(-5, 5, 9)))
    points = field.lattice_points()
    seen = points[found.seen(points) >= 9]
    faced = found.faced(seen, 0.5)
    away = np.hypot(seen[:, 0], seen[:, 1])
    assert len(seen) > 100
    assert (faced[away < 0.2] >= 8).mean() > 0.95
    rim = away > np.percentile(away, 98)
    assert (faced[rim] >= 8).mean() < 0.1
    assert (found.faced(seen, 0.99) <= faced).all()


def chart(rows=30, level=20, columns=48):
    axis = np.stack([np.full(rows, 0.02), np.minimum(np.arange(rows), level - 1) * 0.05 - 1.0,
                     0.01 * np.minimum(np.arange(rows), level - 1)], axis=1)
    elevation = np.maximum(np.arange(rows) - (level - 1), 0) * 0.12
    angle = (np.arange(columns) + 0.5) / columns * 2 * np.pi - np.pi
    return Chart(axis, elevation, angle, 0.05, level)


def test_a_chart_knows_its_points_places():
    one = chart()
    distance = 0.3 + 0.1 * np.random.default_rng(0).random((30, 48))
    places, away = one.places(one.points(distance).reshape(-1, 3))
    rows, columns = np.mgrid[:30, :48]
    assert np.allclose(places[0], rows.ravel(), atol=1e-6)
    assert np.allclose(np.cos((places[1] - columns.ravel()) * 2 * np.pi / 48), 1, atol=1e-6)
    assert np.allclose(away, distance.ravel(), atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(some.integers(0, 10 ** 6))
def test_a_membrane_stays_within_what_it_hangs_from(seed):
    random = np.random.default_rng(seed)
    known = random.random((9, 12)) < 0.3
    known[random.integers(9), random.integers(12)] = True
    values = random.random((9, 12, 2))
    found = continued(values, known)
    assert np.allclose(found[known], values[known])
    assert found.min() >= values[known].min() - 1e-9
    assert found.max() <= values[known].max() + 1e-9


def test_a_plate_goes_on_as_it_curves():
    columns, gap = 72, 14
    angle = 2 * np.pi * (np.arange(columns) + 0.5) / columns
    values = np.repeat((0.3 + 0.05 * np.cos(angle) + 0.02 * np.sin(angle))[None], 12, axis=0)
    known = np.ones((12, columns), bool)
    known[:, 20:20 + gap] = False
    plate = continued(values[..., None], known, bending=1.0)[..., 0]
    membrane = continued(values[..., None], known)[..., 0]
    assert np.abs(plate - values).max() < 0.25 * np.abs(membrane - values).max()


def test_pieces_hang_together_around_the_seam():
    cells = np.zeros((10, 20), bool)
    cells[4:6, :3] = cells[4:6, -3:] = True
    cells[1, 10] = True
    found = large_pieces(cells, np.ones((10, 20)), 8.0)
    assert found[4:6, :3].all() and found[4:6, -3:].all() and not found[1, 10]
    assert found.sum() == 12
