"""Closed eyes: found by their landmarks and the photo, and closed in the painting."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.example import Exemplar, TransferConfig, fitting, transfer
from lfportrait.example.lids import asked_lids, closed, eye_openings, lids_together, shut_eyes
from tests.portraits import drawn_face


def with_openings(points, left, right):
    """Landmarks whose eyes' height over their width is given."""
    points = points.copy()
    for first, opening in ((36, left), (42, right)):
        width = np.linalg.norm(points[first] - points[first + 3])
        for upper, lower in ((1, 5), (2, 4)):
            middle = 0.5 * (points[first + upper] + points[first + lower])
            half = np.array([0, 0.5 * opening * width])
            points[first + upper], points[first + lower] = middle - half, middle + half
    return points


@pytest.fixture(scope="module")
def painting():
    """A face with wide white eyes."""
    return drawn_face(400, 300)


def in_eye(exemplar, first):
    """Colors in the middle of an eye of a painting whose landmarks are given, [N, 3]."""
    eye = exemplar.landmarks[first:first + 6]
    (x0, y0), (x1, y1) = eye.min(axis=0), eye.max(axis=0)
    x, y = (x0 + x1) / 2, y0 + 0.4 * (y1 - y0)
    return exemplar.image[int(y) - 1:int(y) + 2, int(x - 4):int(x + 5)].reshape(-1, 3)


def test_each_eye_is_judged_by_itself():
    points = drawn_face(400, 300).landmarks
    assert shut_eyes(with_openings(points, 0.3, 0.3)) == (False, False)
    assert shut_eyes(with_openings(points, 0.1, 0.3)) == (True, False)
    assert shut_eyes(with_openings(points, 0.3, 0.02)) == (False, True)
    unknown = points.copy()
    unknown[36:48] = np.nan
    assert shut_eyes(unknown) == (False, False)


def test_the_photo_decides_on_narrow_eyes():
    points = with_openings(drawn_face(400, 300).landmarks, 0.2, 0.2)
    photo = np.full((400, 300, 3), 200, np.uint8)
    for first in (36, 42):
        eye = points[first:first + 6]
        x, y = eye.mean(axis=0).astype(int)
        if first == 42:  # an iris; the other has the line of its lashes alone
            photo[y - 3:y + 4, x - 4:x + 5] = 50
        else:
            photo[int(eye[4, 1]), int(eye[0, 0]):int(eye[3, 0])] = 40
    assert shut_eyes(points, photo) == (True, False)
    assert shut_eyes(points) == (False, False)


def test_only_the_shut_eye_of_a_painting_is_changed(painting):
    wink = closed(painting, (True, False))
    assert closed(painting, (False, False)) is painting
    left, right = eye_openings(wink.landmarks)
    assert left < 0.15 and right == pytest.approx(eye_openings(painting.landmarks)[1])
    middle = painting.image.shape[1] // 2
    np.testing.assert_array_equal(wink.image[:, middle:], painting.image[:, middle:])
    # The white of the eye has become skin.
    white, skin = (250, 250, 250), (225, 180, 150)
    shut = in_eye(replace(wink, landmarks=painting.landmarks), 36).mean(axis=0)
    assert np.abs(shut - skin).max() < 25 < np.abs(shut - white).max()
    # Mouth, chin and hair stay as they are.
    low = int(painting.landmarks[30, 1])
    np.testing.assert_array_equal(wink.image[low:], painting.image[low:])


@pytest.mark.parametrize("edge, around", [(250, 120), (40, 170)])
def test_a_lid_has_the_colors_of_the_skin_around(painting, edge, around):
    """A light edge of a lid in a dark socket, drawn down over the whole eye, would be pale."""
    image = painting.image.copy()
    eye = painting.landmarks[36:42]
    width = eye[3, 0] - eye[0, 0]
    top, bottom = int(eye[1:3, 1].mean()), int(eye[4:, 1].mean())
    left, right = int(eye[0, 0] - width / 2), int(eye[3, 0] + width / 2)
    socket = np.s_[int(painting.landmarks[17:22, 1].max()) + 2:bottom + int(width / 2), left:right]
    inside = (image[socket] > 240).all(axis=-1)
    image[socket][~inside] = around
    image[top - int(0.25 * width):top - 1, int(eye[0, 0]):int(eye[3, 0])] = edge
    shut = closed(replace(painting, image=image), (True, False))
    lid = in_eye(replace(shut, landmarks=painting.landmarks), 36).mean()
    assert abs(lid - around) < 0.7 * abs(edge - around)


def test_a_lid_in_a_dark_socket_has_the_light_of_the_cheek(painting):
    image = painting.image.copy()
    eye = painting.landmarks[36:42]
    width = eye[3, 0] - eye[0, 0]
    bottom = int(eye[4:, 1].mean())
    left, right = int(eye[0, 0] - width / 2), int(eye[3, 0] + width / 2)
    image[int(painting.landmarks[17:22, 1].max()):bottom, left:right] = 40
    image[bottom + 2:bottom + int(width), left:right] = 200
    shut = closed(replace(painting, image=image), (True, False))
    assert in_eye(replace(shut, landmarks=painting.landmarks), 36).mean() > 100


def test_closed_paintings_keep_what_is_known_of_them(painting):
    shut = closed(painting, (True, True))
    before, now = painting.regions(), shut.regions()
    np.testing.assert_array_equal(before.person, now.person)
    np.testing.assert_array_equal(now.landmarks, shut.landmarks)


def test_eyes_that_are_painted_shut_stay(painting):
    asleep = replace(painting, landmarks=with_openings(painting.landmarks, 0.1, 0.3))
    sitter = with_openings(painting.landmarks, 0.05, 0.05)
    assert asked_lids(asleep, sitter) == (False, True)


def test_detected_lids_of_shut_eyes_meet_at_the_lashes(painting):
    points = with_openings(painting.landmarks, 0.16, 0.3)
    moved = lids_together(points, (True, False))
    np.testing.assert_array_equal(moved[[40, 41]], points[[40, 41]])
    np.testing.assert_array_equal(moved[42:], points[42:])
    assert eye_openings(moved)[0] < 0.1


@pytest.mark.slow  # paints a photo
def test_photos_with_closed_eyes_are_painted_so(painting):
    sitter = drawn_face(400, 300, seed=3)
    points = with_openings(sitter.landmarks, 0.1, 0.1)
    photo = closed(sitter, (True, True)).image
    assert fitting(painting, points, photo, "painted") is painting
    results = [transfer(photo, painting, TransferConfig(eyes=eyes), points).image
               for eyes in ("auto", "painted")]
    x, y = (points[36:42].mean(axis=0)).astype(int)
    skin = np.array((225, 180, 150)) / 255
    away = [float(np.abs(one[y - 5:y + 2, x - 4:x + 5] - skin).max()) for one in results]
    assert away[0] < 0.15 < away[1]  # the white of an eye shows in the other


def test_an_exemplar_is_reduced_with_its_lids(painting):
    small = closed(painting, (True, True)).within(painting.size / 2)
    assert small.regions().person.shape == small.image.shape[:2]
    assert isinstance(small, Exemplar) and small.lids == (True, True)
