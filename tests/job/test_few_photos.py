"""Which way photos become a head, and what is said of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import CalibrateConfig, PhotosError
from lfportrait.errors import UserError
from lfportrait.job import is_few, prepare
from lfportrait.job.made_from import head_way
from lfportrait.progress import Progress
from tests.capture.calibration.test_head_motion import COUNT, photos


def folder(path: Path, count: int) -> Path:
    path.mkdir(exist_ok=True)
    for number in range(count):
        Image.fromarray(np.full((20, 16, 3), number, np.uint8)).save(path / f"{number}.png")
    return path


@pytest.fixture
def fitted(monkeypatch):
    """What heads were fitted to: the number of photos, and what was said."""
    capture, _, _ = photos(0.0, 90)
    seen = []

    def fit(given, progress):
        seen.append(len(given))
        return replace(capture, figures={"mattes": "given"}), {}
    monkeypatch.setattr("lfportrait.face.portrait_capture", fit)
    monkeypatch.setattr(Progress, "say", lambda self, line: seen.append(line))
    return seen


def prepared(source, **choices):
    with Progress("capture", 0, False) as progress:
        return prepare.prepare_capture(source, CalibrateConfig(), progress=progress, **choices)


@pytest.mark.parametrize("count, ways", [
    (1, ("face", "face", "photos")), (2, ("face", "face", "photos")),
    (3, ("either", "face", "photos")), (9, ("either", "face", "photos")),
    (10, ("photos", "face", "photos"))])
def test_the_way_follows_from_the_number_of_photos_or_the_choice(tmp_path, count, ways):
    source = folder(tmp_path, count)
    assert tuple(head_way(source, choice) for choice in ("auto", "face", "photos")) == ways
    assert is_few(source) == (count < 10)


def test_a_file_is_one_photo(tmp_path, fitted):
    source = folder(tmp_path, 1) / "0.png"
    assert head_way(source, "auto") == "face" and is_few(source)
    _, figures = prepared(source)
    assert fitted == ["1 photo: a head is fitted to the face (--from face)", 1]
    assert "not_together" not in figures


def test_what_has_cameras_is_not_fitted(tmp_path):
    found, _, boxes = photos(0.0, 90)
    replace(found, cameras=boxes).save(tmp_path / "capture")
    assert head_way(tmp_path / "capture", "auto") == "photos"
    assert not is_few(tmp_path / "capture")
    with pytest.raises(UserError, match="has cameras already; leave out --from face"):
        head_way(tmp_path / "capture", "face")


@pytest.mark.parametrize("placed", [0, COUNT])
def test_a_few_photos_that_do_not_belong_together_go_by_the_face(tmp_path, monkeypatch, fitted,
                                                               placed):
    found, _, _ = photos(0.0, 90)

    def apart(*_):
        if placed == 0:
            raise PhotosError("the photos do not overlap enough", {})
        return replace(found, figures={"photos": 2 * COUNT, "blurred": [], "left_out": []})
    monkeypatch.setattr(prepare, "calibrate", apart)
    _, figures = prepared(folder(tmp_path, 5))
    assert fitted == ["5 photos that can't be placed together: a head is fitted to the face "
                      "(--from face)", 5]
    assert ("overlap" if placed == 0 else "placed together") in figures["not_together"]


def test_what_can_be_placed_is_and_a_line_says_so(tmp_path, monkeypatch, fitted):
    found, _, boxes = photos(0.0, 90)
    placed = replace(found, cameras=boxes, figures={"photos": COUNT, "blurred": [], "left_out": []})
    monkeypatch.setattr(prepare, "calibrate", lambda *_: placed)
    points = np.random.default_rng(0).normal(size=(68, 3))
    monkeypatch.setattr("lfportrait.face.landmarks_of_capture",
                        lambda capture, progress: (points, {"views": 5, "outliers": 0.1}))
    capture, _ = prepared(folder(tmp_path, COUNT), keep_background=True)
    assert len(capture) == COUNT
    assert fitted == [f"{COUNT} photos are placed together: the head is made from what they share "
                      "(--from photos; --from face fits one to the face)"]
    # Cameras of something else than the face.
    monkeypatch.setattr("lfportrait.face.landmarks_of_capture",
                        lambda capture, progress: (points, {"views": 5, "outliers": 0.9}))
    with pytest.warns(UserWarning, match="the room behind the person is not kept"):
        prepared(tmp_path, keep_background=True)
    assert fitted[-1] == COUNT


def test_where_both_fail_both_are_named(tmp_path, monkeypatch):
    def fail(error):
        def run(*_, **__):
            raise error
        return run
    monkeypatch.setattr(prepare, "calibrate", fail(PhotosError("the photos do not overlap", {})))
    # Plain pictures, in which a detector looks for faces in vain, for a second each.
    monkeypatch.setattr("lfportrait.face.face_cameras.detect_landmarks", lambda *_, **__: None)
    monkeypatch.setattr("lfportrait.face.portrait_capture",
                        fail(UserError("no face was found in 0.png")))
    with pytest.raises(UserError, match="overlap; nor can a head be fitted: no face was found"):
        prepared(folder(tmp_path, 4))
    # By hand, the one way that was asked for.
    with pytest.raises(UserError, match=r"^the photos do not overlap$"):
        prepared(tmp_path, made_from="photos")
    with pytest.raises(UserError, match=r"^no face was found"):
        prepared(tmp_path, made_from="face")
