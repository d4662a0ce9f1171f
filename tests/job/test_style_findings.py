"""What is told of a painting before a head is painted by it."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.job.style_check import findings, oval_frame
from tests.portraits import drawn_face


@pytest.fixture(scope="module")
def large():
    """A face of more than 300 pixels, with nothing to be told of."""
    return drawn_face(1100, 860)


def names(exemplar, yaw=0.0, rows=680):
    return {one.name: one for one in findings(exemplar, yaw, rows)}


def framed(image, color, inset=0, waves=0.0):
    """A picture in an oval frame, or one whose edge is a wave."""
    height, width = image.shape[:2]
    y, x = np.mgrid[:height, :width] + 0.5
    x, y = (x - width / 2) / (width / 2 - inset), (y - height / 2) / (height / 2 - inset)
    out = image.copy()
    out[np.hypot(x, y) > 1 - waves * (1 + np.sin(6 * np.arctan2(y, x)))] = color
    return out


def test_of_a_plain_large_face_nothing_is_told(large):
    assert not {"coarse", "oval", "half_mirrored", "half_in_shadow", "eyes_closed",
                "mouth_open"} & set(names(large))


def test_small_faces_are_coarse_by_so_much(large):
    small = large.within(large.size / 4)
    found = names(small)["coarse"]
    pixels = np.ptp(small.landmarks[:, 1])
    assert found.value == pytest.approx(680 / pixels, abs=0.01)
    assert f"{680 / pixels:.1f} times" in found.text


# A frame of another color and width is found in the same way.
@pytest.mark.parametrize(("color", "inset"), [
    ((250, 250, 250), 0), pytest.param((20, 18, 15), 25, marks=pytest.mark.slow)])
def test_oval_frames_are_found(large, color, inset):
    left, top, right, bottom = oval_frame(framed(large.image, color, inset))
    height, width = large.image.shape[:2]
    assert max(abs(left - inset), abs(top - inset), abs(width - right - inset),
               abs(height - bottom - inset)) < 9
    picture = replace(large, image=framed(large.image, color, inset), mask=None)
    assert "Crop it" in names(picture)["oval"].text


def test_other_plain_corners_are_no_frame(large):
    assert oval_frame(large.image) is None
    assert oval_frame(framed(large.image, (250, 250, 250), 20, waves=0.15)) is None
    plain = np.full_like(large.image, 240)
    plain[200:800, 200:500] = large.image[200:800, 200:500]
    assert oval_frame(plain) is None
    assert oval_frame(np.full((40, 40, 3), 90, np.uint8)) is None


def test_turned_faces_and_shade_are_told(large):
    assert "50 degrees" in names(large, yaw=-50.0)["half_mirrored"].text
    dark = large.image.copy()
    middle = dark.shape[1] // 2
    dark[:, :middle] = dark[:, :middle] * 0.2
    assert "picture's left" in names(replace(large, image=dark))["half_in_shadow"].text


def test_closed_eyes_and_open_mouths_are_told(large):
    points = large.landmarks.copy()
    for upper, lower in ((37, 41), (38, 40)):
        points[upper] = points[lower] - [0, 1]
    for upper, lower in ((61, 67), (62, 66), (63, 65)):
        points[upper] -= [0, 10]
        points[lower] += [0, 10]
    found = names(replace(large, landmarks=points))
    assert found["eyes_closed"].value == [True, False] and "One eye" in found["eyes_closed"].text
    assert "--keep lips" in found["mouth_open"].text


def test_a_hand_at_the_face_is_told_where_the_network_is_there(large, monkeypatch):
    body, regions = np.zeros(large.image.shape[:2], np.float32), large.regions()
    monkeypatch.setattr("lfportrait.models.missing", lambda names: [])
    monkeypatch.setattr("lfportrait.face.parts", lambda image: {"body-skin": body})
    monkeypatch.setattr("lfportrait.example.Exemplar.regions", lambda self: regions)
    assert "hand" not in names(large)
    x, y = large.landmarks[[2, 31]].mean(axis=0).astype(int)
    body[y - 60:y + 60, x - 60:x + 60] = 1
    assert "hand" in names(large)
