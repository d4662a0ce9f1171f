"""Open mouths: what a photo shows between the lips, in the painter's colors."""

import numpy as np
import pytest

from lfportrait.example import Transfer, TransferConfig, parts_lips, transfer
from lfportrait.example.lids import closed
from lfportrait.example.mouth import Palette, lips_apart, part_lips, with_open_mouth
from lfportrait.example.video import reduced
from lfportrait.face import mouth_opening
from tests.portraits import drawn_face

SKIN, LIPS, TEETH, DARK = np.array([(0.8, 0.6, 0.5), (0.7, 0.25, 0.25), (0.9, 0.88, 0.85),
                                    (0.1, 0.05, 0.05)], np.float32)


def with_gap(points, opening):
    """Landmarks whose inner lips stand apart, over the mouth's width."""
    points = points.copy()
    width = np.linalg.norm(points[54] - points[48])
    for upper, lower in ((61, 67), (62, 66), (63, 65)):
        middle = 0.5 * (points[upper] + points[lower])
        points[upper] = middle - np.array([0, 0.5 * opening * width])
        points[lower] = middle + np.array([0, 0.5 * opening * width])
    # The lips around it.
    for one in range(49, 54):
        points[one, 1] = points[61:64, 1].mean() - 0.12 * width
    for one in range(55, 60):
        points[one, 1] = points[65:68, 1].mean() + 0.12 * width
    return points


@pytest.fixture(scope="module")
def painting():
    """A face with closed lips, white eyes and a dark line between the lips."""
    drawn = drawn_face(400, 300)
    points = drawn.landmarks
    points[:] = with_gap(points, 0.01)
    row = int(points[62, 1])
    drawn.image[row - 1:row + 1, int(points[60, 0]):int(points[64, 0])] = 30
    return drawn


@pytest.fixture(scope="module")
def smile(painting):
    """A photo of teeth with dark below them, and its landmarks."""
    points = with_gap(painting.landmarks, 0.3)
    photo = np.broadcast_to(SKIN, (400, 300, 3)).copy()
    left, top = np.floor(points[48:60].min(axis=0)).astype(int)
    right, bottom = np.ceil(points[48:60].max(axis=0)).astype(int)
    photo[top:bottom, left:right] = LIPS
    (x, upper), lower = points[62].astype(int), int(points[66, 1])
    middle = (upper + lower) // 2
    photo[upper:middle, left:right] = TEETH
    photo[middle:lower, left:right] = DARK
    return photo, points, (x, upper, middle, lower)


def test_a_mouth_is_open_where_the_painted_one_is_not(painting):
    assert mouth_opening(with_gap(painting.landmarks, 0.3)) == pytest.approx(0.3)
    assert parts_lips(painting, with_gap(painting.landmarks, 0.2))
    assert not parts_lips(painting, with_gap(painting.landmarks, 0.02))
    unknown = with_gap(painting.landmarks, 0.2)
    unknown[60:68] = np.nan
    assert not parts_lips(painting, unknown)
    laughing = drawn_face(400, 300)
    laughing.landmarks[:] = with_gap(laughing.landmarks, 0.3)
    assert not parts_lips(laughing, with_gap(painting.landmarks, 0.2))


def test_teeth_are_the_painters_white_and_the_gap_his_dark(painting, smile):
    photo, points, (x, upper, middle, lower) = smile
    paint = np.full(photo.shape, 0.5, np.float32)
    part_lips(paint, photo, points, Palette.of(painting))
    teeth, dark = paint[(upper + middle) // 2, x], paint[(middle + lower) // 2, x]
    assert teeth.mean() > 0.7 and dark.mean() < 0.3
    # Nothing but the gap is painted.
    box = np.zeros(photo.shape[:2], bool)
    low, high = points[60:68].min(axis=0) - 3, points[60:68].max(axis=0) + 3
    box[int(low[1]):int(high[1]) + 1, int(low[0]):int(high[0]) + 1] = True
    np.testing.assert_array_equal(paint[~box], np.float32(0.5))
    assert (paint[box] != 0.5).any()


def test_what_is_as_red_as_the_lips_stays_painted(painting, smile):
    photo, points, (x, _, middle, lower) = smile
    tongue = photo.copy()
    tongue[middle:lower] = LIPS
    paint = np.full(photo.shape, 0.5, np.float32)
    part_lips(paint, tongue, points, Palette.of(painting))
    assert np.abs(paint[(middle + lower) // 2, x] - 0.5).max() < 0.15


def test_whole_numbers_and_places_in_another_plane_give_the_same(painting, smile):
    photo, points, _ = smile
    first = np.full(photo.shape, 0.5, np.float32)
    part_lips(first, np.uint8(255 * photo + 0.5), points, Palette.of(painting))
    rows, columns = np.mgrid[:400, :300]
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    places = np.stack([columns, rows], axis=-1).reshape(-1, 2) + 0.5
    second = with_open_mouth(np.full((photo.size // 3, 3), 0.5, np.float32),
                             photo.reshape(-1, 3), (0.01 * places @ turn.T).astype(np.float32),
                             0.01 * points @ turn.T, Palette.of(painting)).reshape(photo.shape)
    np.testing.assert_allclose(first, second, atol=0.02)


def test_a_mouth_that_cannot_be_made_out_leaves_the_paint(painting, smile):
    photo, points, _ = smile
    paint = np.full((photo.size // 3, 3), 0.5, np.float32)
    rows, columns = np.mgrid[:400, :300]
    places = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(np.float32)
    unknown, far, painter = points.copy(), points + 5000, Palette.of(painting)
    unknown[62] = np.nan
    assert with_open_mouth(paint, photo.reshape(-1, 3), places, unknown, painter) is paint
    assert with_open_mouth(paint, photo.reshape(-1, 3), places, far, painter) is paint
    part_lips(photo.copy(), photo, far, painter)


def test_a_transfer_paints_the_smile(painting, smile):
    photo, points, (x, upper, middle, _) = smile
    face = painting.image / np.float32(255)
    low, high = points[48:60].min(axis=0).astype(int), points[48:60].max(axis=0).astype(int)
    face[low[1]:high[1], low[0]:high[0]] = photo[low[1]:high[1], low[0]:high[0]]
    made = transfer(np.uint8(255 * face), painting, TransferConfig(), points).image
    closed = transfer(np.uint8(255 * face), painting, TransferConfig(),
                      with_gap(points, 0.03)).image
    place = (upper + middle) // 2, x
    assert made[place].mean() > closed[place].mean() + 0.1


def test_a_mouth_that_opens_does_not_jump(painting, smile):
    photo, points, (x, upper, *_) = smile
    painter, before, steps = Palette.of(painting), None, []
    for opening in np.arange(0.06, 0.2, 0.005):
        marks = with_gap(points, opening)
        paint = np.full(photo.shape, 0.5, np.float32)
        if parts_lips(painting, marks):
            part_lips(paint, photo, marks, painter)
        if before is not None:
            steps.append(np.abs(paint - before)[upper - 3:upper + 12, x - 6:x + 6].mean())
        before = paint
    assert max(steps) < 0.12 and sum(steps) > 0.2


def test_a_shut_eye_has_a_white_too(painting):
    shut = closed(painting, (True, True))
    small = reduced(Transfer(shut), 2.0)
    for palette in (Palette.of(shut), small.palette):
        np.testing.assert_allclose(palette.white, Palette.of(painting).white, atol=0.02)


def test_the_line_between_painted_lips_is_in_the_gap(painting):
    points = painting.landmarks
    apart = lips_apart(points)
    moved = np.flatnonzero((apart != points).any(axis=1))
    assert set(moved) == {61, 62, 63, 65, 66, 67}
    assert (apart[61:64, 1] < points[61:64, 1]).all()
    assert (apart[65:68, 1] > points[65:68, 1]).all()
    assert (apart[61:64, 1] > points[50:53, 1]).all()
