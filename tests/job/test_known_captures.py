"""Captures that were read before come without their pictures, until somebody looks at one."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import Capture, LatePictures
from lfportrait.errors import UserError
from lfportrait.job import capture_of_face
from lfportrait.media.depth import DepthMap
from tests.capture.calibration.test_head_motion import photos


@pytest.fixture
def folder(tmp_path):
    """A calibrated data set with mattes and landmarks."""
    found, mattes, boxes = photos(0.0, 90)
    replace(found, cameras=boxes, alphas=[np.uint8(matte * 255) for matte in mattes],
            landmarks=np.random.default_rng(0).normal(size=(68, 3))).save(tmp_path / "capture")
    return tmp_path / "capture"


@pytest.fixture
def loaded(monkeypatch):
    """How often a capture was read from its files."""
    read, load = [], Capture.load

    def counted(path, *rest):
        read.append(path)
        return load(path, *rest)
    monkeypatch.setattr(Capture, "load", staticmethod(counted))
    return read


def test_pictures_are_decoded_when_they_are_looked_at(folder, loaded):
    first = capture_of_face(folder)
    assert len(loaded) == 1 and not isinstance(first.images, LatePictures)
    again = capture_of_face(folder)
    assert len(loaded) == 1 and len(again.images) == len(again.alphas) == len(first)
    for name in ("pose", "focal", "center", "width", "height"):
        assert np.array_equal(getattr(again.cameras, name), getattr(first.cameras, name))
    assert np.array_equal(again.landmarks, first.landmarks) and again.names == first.names
    assert np.array_equal(again.held_out, first.held_out)
    assert np.array_equal(again.frame, first.frame)
    assert len(loaded) == 1
    assert all(np.array_equal(a, b) for a, b in zip(again.images, first.images, strict=True))
    assert all(np.array_equal(a, b) for a, b in zip(again.alphas, first.alphas, strict=True))
    assert len(loaded) == 2
    assert np.array_equal(again.image_float(1), first.image_float(1)) and len(loaded) == 2


def test_depth_is_read_when_it_is_looked_at(folder, loaded):
    capture = Capture.load(folder)
    depth = DepthMap(np.full((4, 5), 2.0, np.float32), "distance", True)
    replace(capture, depths=[depth] + [None] * (len(capture) - 1)).save(folder)
    capture_of_face(folder)
    loaded.clear()
    again = capture_of_face(folder)
    assert not loaded and len(again.depths) == len(capture)
    assert np.array_equal(again.depths[0].values, depth.values) and again.depths[1] is None
    assert len(loaded) == 1


def test_another_file_is_another_capture(folder, loaded):
    capture_of_face(folder)
    picture = next((folder / "images").glob("*.png"))
    picture.write_bytes(picture.read_bytes() + b"\0")
    capture_of_face(folder)
    assert len(loaded) == 2


def test_what_is_no_capture_is_told(tmp_path):
    with pytest.raises(UserError, match="no folder or file"):
        capture_of_face(tmp_path / "nowhere")
    (tmp_path / "transforms.json").write_text("{")
    with pytest.raises(UserError, match="JSON"):
        capture_of_face(tmp_path)
