"""Where a painting is drawn in lines, its lines are copied whole."""

import numpy as np
import pytest

from lfportrait.example import Transfer, transfers
from lfportrait.example.guides.filters import drawn_lines
from lfportrait.example.guides.regions import Regions, soft_face
from tests.portraits import drawn_face, with_lines

STEP = 48


@pytest.fixture(scope="module")
def face():
    return drawn_face(320, 240)


@pytest.fixture(scope="module")
def soft(face):
    return soft_face(face.image.shape, face.landmarks)


def test_lines_are_found(face, soft):
    found = drawn_lines(with_lines(face, STEP).image, soft, face.size)
    left, right = np.rint(face.landmarks[[48, 54], 0]).astype(int)
    line = 4 * STEP  # Between eyes and chin.
    assert face.landmarks[27, 1] < line < face.landmarks[8, 1]
    assert (found[line - 2:line + 5, left:right] > 195).all()
    assert (found[line + 20:line + 30, left:right] < 55).all()
    # At the jaw, too, but not beyond: what hair and clothes are drawn in is not the face's.
    assert not found[soft == 0].any() and found[(soft > 20) & (soft < 127)].max() > 100


def test_what_is_no_line(face, soft):
    plain = np.full_like(face.image, 180)
    assert not drawn_lines(plain, soft, face.size).any()
    # Light that changes slowly.
    slow = plain - np.uint8(np.linspace(0, 120, len(plain)))[:, None, None]
    assert drawn_lines(slow, soft, face.size).max() < 35
    # Faint lines in the places of the others, and a face that lies outside of the picture.
    lined = with_lines(face, STEP).image
    assert drawn_lines(np.uint8(200 + lined * 0.05), soft, face.size).max() < 55
    assert not drawn_lines(lined, np.zeros_like(soft), face.size).any()


def test_lines_stay_whole_on_a_photo_of_a_leaning_face(face, monkeypatch):
    """Its light is noise, and pieces of a painting that stands upright do not lean with it."""
    lined = with_lines(face, 24)
    lean, middle = np.radians(12), face.landmarks.mean(axis=0)
    turn = np.array([[np.cos(lean), -np.sin(lean)], [np.sin(lean), np.cos(lean)]])
    points = middle + (face.landmarks - middle) @ turn.T
    photo = np.random.default_rng(0).integers(0, 256, face.image.shape, np.uint8)
    person = np.ones(photo.shape[:2], np.float32)
    own, regions = Regions(lined.landmarks, person, None), Regions(points, person, None)
    inside, away = soft_face(photo.shape, points) > 250, []

    def paint():
        made = Transfer(lined, regions=own).apply(photo, points, regions=regions)
        x, y = np.moveaxis(made.guides.position[inside].astype(int), -1, 0)
        away.append(np.abs(made.image[inside] - lined.image[y, x] / 255).mean())

    paint()
    monkeypatch.setattr(transfers, "HOLD", np.float32(0))
    paint()
    monkeypatch.setattr(transfers.filters, "drawn_lines",
                        lambda image, *rest: np.zeros(image.shape[:2], np.uint8))
    paint()
    assert 2 * away[0] < away[1] < away[2]
