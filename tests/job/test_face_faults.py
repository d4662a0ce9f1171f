"""What lies before the face in a single photo is said."""

import numpy as np
import pytest

from lfportrait.job.made_from import face_faults
from lfportrait.job.photo_check import check_photos
from tests.portraits import CANONICAL

FACE = CANONICAL * 60 + 100
"""Landmarks in a picture of 200 pixels."""


@pytest.fixture
def seen(monkeypatch):
    """What the networks see: masks by their names; and whether spectacles are worn."""
    maps = {"hair": np.zeros((200, 200), np.float32), "body-skin": np.zeros((200, 200), np.float32),
            "glasses": np.zeros((200, 200), np.float32)}
    monkeypatch.setattr("lfportrait.models.missing", lambda names: [])
    monkeypatch.setattr("lfportrait.face.hair_mask", lambda image: maps["hair"])
    monkeypatch.setattr("lfportrait.face.parts", lambda image: maps)
    monkeypatch.setattr("lfportrait.face.find_spectacles",
                        lambda image, points, sure: (
                            maps["glasses"] if maps["glasses"].any() else None))
    return maps


def said():
    return face_faults(np.zeros((200, 200, 3), np.uint8), FACE, "her.jpg")


def test_a_bare_face_is_well(seen):
    seen["hair"][:70] = 1  # above the brows
    seen["hair"][140:] = 1  # a beard
    seen["body-skin"][165:] = 1  # a neck
    assert said() == []


def test_hair_over_one_half_is_said(seen):
    seen["hair"][:, :105] = 1
    found, = said()
    assert "hair covers 100 % of one half of the face in her.jpg" in found


def test_a_hand_and_glasses_are_said(seen):
    seen["body-skin"][110:150, 80:130] = 1
    seen["glasses"][90, 80:120] = 1
    assert [line.split(" ")[:2] for line in said()] == [["a", "hand"], ["the", "glasses"]]


def test_without_networks_nothing_is_said_of_what_they_find(seen, monkeypatch):
    monkeypatch.setattr("lfportrait.models.missing", lambda names: list(names))
    seen["hair"][:] = seen["body-skin"][:] = 1
    assert said() == []


@pytest.fixture
def one(monkeypatch, tmp_path):
    """Checks a single photo in which these faces are found, seen from some degrees aside."""
    from PIL import Image

    from lfportrait.capture import Camera
    from lfportrait.demo import demo_landmarks

    Image.fromarray(np.full((200, 200, 3), 90, np.uint8)).save(tmp_path / "her.png")

    def check(*yaws):
        faces = [Camera.arc(np.array([float(yaw)]), distance=5.0, width=200, height=200, focal=300
                            ).project(demo_landmarks())[0][0] for yaw in yaws]
        monkeypatch.setattr("lfportrait.job.photo_check._can_see_faces", lambda: True)
        monkeypatch.setattr("lfportrait.job.photo_check.detect_landmarks",
                            lambda image, **_: faces[0] if faces else None)
        monkeypatch.setattr("lfportrait.job.photo_check.detect_faces", lambda image, **_: faces)
        return check_photos(tmp_path)
    return check


def test_one_photo_is_checked_as_one(one):
    found = one(5)
    assert found.advice == [] and found.photos[0].wrong == "" and found.gaps == []
    assert "over 40 degrees in all" in found.notes[0]
    assert "no face" in one().photos[0].wrong
    assert "turned too far in her.png" in one(60).advice[0]
    found = one(0, 5)
    assert found.photos[0].wrong == "several faces" and "crop it" in found.advice[0]
