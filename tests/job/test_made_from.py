"""Films of people who talk, and pictures from one side: a head is fitted to the best of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import CalibrateConfig, Photo, calibrate
from lfportrait.errors import UserError
from lfportrait.face import FROM_MEDIAPIPE, GENERIC_LANDMARKS
from lfportrait.job import made_from, prepare
from lfportrait.job.made_from import FaceLook, best_pictures, face_changes, reason_to_fit
from lfportrait.job.work import say_poor
from lfportrait.progress import Progress
from tests.capture.calibration.test_head_motion import photos as moved_photos

CALM = FaceLook(yaw=0, pitch=5, roll=0, eyes=0.3, gaze=0, mouth=0.01, width=0.56, brows=0.24,
                size=150, sharpness=0.3)


@pytest.fixture
def seen(monkeypatch):
    """What is seen in pictures, by the number that their first pixel holds."""
    looks: list[FaceLook | None] = []
    monkeypatch.setattr(made_from.models, "missing", lambda names: [])
    monkeypatch.setattr(made_from, "look_at_face", lambda image: looks[int(image[0, 0, 0])])
    return looks


def pictures(count: int) -> list[Photo]:
    return [Photo(f"frame_{number:04d}.png", np.full((24, 32, 3), number, np.uint8))
            for number in range(count)]


def talking(count: int, arc: float) -> list[FaceLook | None]:
    yaws = np.linspace(-arc / 2, arc / 2, count)
    return [replace(CALM, yaw=float(yaw), mouth=0.1 * (number % 3))
            for number, yaw in enumerate(yaws)]


def still(count: int, arc: float) -> list[FaceLook | None]:
    noise = np.random.default_rng(0).normal(0, 0.008, count)
    return [replace(CALM, yaw=float(yaw), mouth=0.01 + abs(one), width=0.56 + one)
            for yaw, one in zip(np.linspace(-arc / 2, arc / 2, count), noise, strict=True)]


@pytest.mark.parametrize("looks, reason", [
    (still(30, 28), ""), (still(30, 10), ""), (talking(30, 110), ""),
    (talking(30, 30), "the face moves in them"),
    (still(30, 4), "they show the face from one side only, over 4 degrees"),
    ([*still(10, 4), *[None] * 20], ""),
    # Up and down is an arc, too.
    ([replace(CALM, pitch=2.0 * k) for k in range(15)], ""),
    # No head is fitted to pictures that lie on their side.
    ([replace(one, roll=88.0) for one in talking(30, 30) if one], "")])
def test_what_the_faces_tell_of_many_pictures(seen, looks, reason):
    seen.extend(looks)
    assert reason_to_fit(pictures(len(looks))) == reason


def test_of_a_hundred_pictures_forty_are_looked_at(seen, monkeypatch):
    seen.extend(still(100, 28))
    asked = []
    look = made_from.look_at_face
    monkeypatch.setattr(made_from, "look_at_face", lambda image: asked.append(1) or look(image))
    assert reason_to_fit(pictures(100)) == ""
    assert 30 <= len(asked) <= 40


def test_a_mouth_that_gets_wider_moves_and_one_seen_from_the_side_does_not():
    assert face_changes([replace(CALM, width=0.5 + 0.02 * k) for k in range(8)])
    assert not face_changes([replace(CALM, yaw=50.0, width=0.5 + 0.02 * k) for k in range(8)])
    assert not face_changes([CALM, replace(CALM, mouth=0.4)])


@pytest.mark.parametrize("worse", [
    {"yaw": 18.0}, {"pitch": 25.0}, {"eyes": 0.1}, {"gaze": 0.15}, {"mouth": 0.3}, {"width": 0.8},
    {"width": 0.4}, {"brows": 0.34}, {"size": 60.0}, {"sharpness": 0.1}])
def test_the_best_picture_is_calm_frontal_sharp_and_near(seen, worse):
    seen.extend([replace(CALM, **worse)] * 4 + [None, *[replace(CALM, sharpness=0.2)] * 7])
    seen[7] = CALM
    names = [one.name for one in best_pictures(pictures(12))]
    assert names[0] == "frame_0007.png" and len(names) == 11 and "frame_0004.png" not in names


def test_where_no_picture_shows_a_face_a_line_says_so(seen):
    seen.extend([None] * 12)
    with pytest.raises(UserError, match="no face was found"):
        best_pictures(pictures(12))


@pytest.fixture
def fitted(monkeypatch):
    """What heads were fitted to, and what was said."""
    capture, _, _ = moved_photos(0.0, 90)
    done: list[object] = []

    def fit(given, progress):
        done.append([one.name for one in given])
        names = [given[0].name, *capture.names[1:]]
        return replace(capture, names=names, figures={"mattes": "given"}), {}
    monkeypatch.setattr("lfportrait.face.portrait_capture", fit)
    monkeypatch.setattr(Progress, "say", lambda self, line: done.append(line))
    return done


def folder(path: Path, count: int) -> Path:
    for number in range(count):
        Image.fromarray(np.full((24, 32, 3), number, np.uint8)).save(path / f"{number:02d}.png")
    return path


def prepared(source, **choices):
    with Progress("capture", 0, False) as progress:
        return prepare.prepare_capture(source, CalibrateConfig(), progress=progress, **choices)


def test_a_face_that_moves_is_not_placed_but_fitted(tmp_path, seen, fitted, monkeypatch):
    seen.extend(talking(12, 20))
    monkeypatch.setattr(prepare, "calibrate", lambda *_, **__: pytest.fail("it was placed"))
    _, figures = prepared(folder(tmp_path, 12))
    assert fitted == [["06.png"], "the best of 12 pictures, 06.png, as the face moves in them: a "
                      "head is fitted to the face (--from face; --from photos uses all)"]
    assert figures["fitted_because"] == "the face moves in them"


def test_of_what_is_left_of_ten_the_best_is_taken(tmp_path, seen, fitted):
    seen.extend(talking(10, 20))
    (folder(tmp_path, 10) / "09.png").write_bytes(b"damaged")
    with pytest.warns(UserWarning, match=r"09\.png"):
        prepared(tmp_path)
    assert fitted[0] == ["03.png"]
    assert fitted[1].startswith("the best of 9 pictures, 03.png, as the face moves")


def test_whoever_asks_for_the_room_gets_it(tmp_path, seen, fitted, monkeypatch):
    seen.extend(talking(12, 20))
    monkeypatch.setattr(prepare, "calibrate", lambda *_, **__: pytest.fail("it is placed"))
    with pytest.raises(pytest.fail.Exception, match="it is placed"):
        prepared(folder(tmp_path, 12), keep_background=True)
    assert fitted == []


def test_where_the_camera_is_does_not_depend_on_how_a_picture_lies(monkeypatch):
    mesh = np.zeros((478, 2))
    turn = np.radians(25.0)
    points = GENERIC_LANDMARKS @ np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0],
                                           [np.sin(turn), 0, np.cos(turn)]])
    mesh[FROM_MEDIAPIPE] = 200 * points[:, :2] * [1, -1] + 300
    for one, two in ((36, 468), (45, 473)):  # irises somewhere between the corners
        mesh[two] = mesh[FROM_MEDIAPIPE[one]] + 1
    seen = []
    for pixels in (mesh, np.stack([mesh[:, 1], 600 - mesh[:, 0]], axis=1)):
        monkeypatch.setattr(made_from, "face_mesh", lambda image, pixels=pixels: pixels)
        seen.append(made_from.look_at_face(np.zeros((600, 600, 3), np.uint8)))
    assert abs(seen[0].yaw) == pytest.approx(25, abs=2) and abs(seen[0].roll) < 3
    assert seen[1].yaw == pytest.approx(seen[0].yaw, abs=0.5)
    assert seen[1].pitch == pytest.approx(seen[0].pitch, abs=0.5)
    assert abs(seen[1].roll) == pytest.approx(90, abs=3)
    assert seen[1].width == pytest.approx(seen[0].width, rel=0.02)


def test_the_next_best_is_tried_and_then_all(tmp_path, seen, fitted, monkeypatch):
    from lfportrait import face

    seen.extend(talking(12, 20))
    fit, good = face.portrait_capture, {"00.png"}

    def picky(given, progress):
        if given[0].name not in good:
            raise UserError(f"{given[0].name} shows 2 faces")
        return fit(given, progress)
    monkeypatch.setattr("lfportrait.face.portrait_capture", picky)
    good.add("03.png")
    prepared(folder(tmp_path, 12))
    assert fitted[0] == ["03.png"] and fitted[1].startswith("the best of 12 pictures, 03.png, as")
    good.clear()
    monkeypatch.setattr(prepare, "calibrate", lambda *_, **__: pytest.fail("it is placed"))
    with pytest.raises(pytest.fail.Exception, match="it is placed"):
        prepared(tmp_path)
    assert fitted[2:] == ["06.png shows 2 faces; so all pictures are used (--from photos)"]


def test_by_hand_they_are_placed(tmp_path, seen, fitted, monkeypatch):
    seen.extend(talking(12, 20))

    class PlacedError(Exception):
        pass

    def placed(*_, read=None):
        raise PlacedError
    monkeypatch.setattr(prepare, "calibrate", placed)
    with pytest.raises(PlacedError):
        prepared(folder(tmp_path, 12), made_from="photos")
    assert fitted == []


def test_pictures_that_were_read_are_handed_over_and_let_go(tmp_path, seen, monkeypatch):
    seen.extend(still(12, 40))
    given = []
    monkeypatch.setattr(prepare, "calibrate",
                        lambda *args, **more: given.append(more["read"]) or calibrate(*args,
                                                                                      **more))
    monkeypatch.setattr("lfportrait.capture.photo_cameras.read_source",
                        lambda *_: pytest.fail("they are read twice"))
    with pytest.raises(UserError):  # twelve plain pictures have nothing to share
        prepared(folder(tmp_path, 12))
    assert given == [[]]


def test_a_field_that_is_far_from_its_photos_is_said(recwarn):
    say_poor({})
    say_poor({"test": {"psnr": 14.0, "psnr_kept": 27.0}})  # a cut is no fault
    assert not recwarn.list
    with pytest.warns(UserWarning, match=r"met with 15 dB only .*--from face"):
        say_poor({"test": {"psnr": 15.3}})
