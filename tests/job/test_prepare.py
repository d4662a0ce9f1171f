"""Photos become a capture: in which order, and what is told."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import CalibrateConfig, PhotosError, portrait_frame_from_landmarks
from lfportrait.errors import UserError
from lfportrait.job import find_face, prepare
from tests.capture.calibration.test_head_motion import COUNT, photos
from tests.capture.test_calibrate import pose_errors


@pytest.mark.slow  # follows: tests/capture/calibration/test_head_motion.py
def test_cameras_follow_a_head_that_moved(tmp_path, monkeypatch):
    found, mattes, boxes = photos(3.0)
    mattes[5] = np.zeros_like(mattes[5])
    found = replace(found, figures={"blurred": [], "left_out": []})
    monkeypatch.setattr(prepare, "calibrate", lambda *_, **__: found)
    monkeypatch.setattr(prepare, "read_source", lambda *_: [])
    given, looked, cut, marked = iter(mattes), [], [], []
    monkeypatch.setattr(prepare, "problem_sheet",
                        lambda photos, marks, sheet, frames: marked.append(marks))

    def landmarks(capture, progress):
        looked.append(len(capture))
        return None, {"views": 0}

    def cutting(capture, progress, soft):
        cut.append((len(capture), len(soft)))
        return capture, "network"
    monkeypatch.setattr("lfportrait.face.landmarks_of_capture", landmarks)
    monkeypatch.setattr("lfportrait.face.person_matte", lambda image, up: next(given))
    monkeypatch.setattr(prepare, "cut_person", cutting)
    with pytest.warns(UserWarning, match=r"1 photos show too little .*: 5\.png; which"):
        capture, figures = prepare.prepare_capture(tmp_path, CalibrateConfig(),
                                                   sheet=tmp_path / "sheet.jpg")
    # The face is looked for once more, as it is what the cameras follow.
    assert looked == [COUNT, COUNT - 1] and cut == [(COUNT - 1, COUNT - 1)]
    assert figures["head_motion"]["followed"] and figures["head_motion"]["left_out"] == ["5.png"]
    assert figures["views"] == COUNT - 1 and marked == [{"5.png": "head not seen"}]
    true = boxes.pose[[0, 1, 2, 3, 4, 6, 7]]
    assert np.median(pose_errors(capture.cameras.pose, true)[0]) < 0.3


@pytest.fixture
def face(monkeypatch):
    """Landmarks that each search finds, and how many views each had."""
    points, looked = np.random.default_rng(0).normal(size=(68, 3)), []

    def landmarks(capture, progress):
        looked.append(len(capture))
        return points, {"views": 5, "error_px": 0.7}
    monkeypatch.setattr("lfportrait.face.landmarks_of_capture", landmarks)
    return points, looked


def test_a_data_sets_face_is_looked_for_once(tmp_path, face):
    found, _, boxes = photos(0.0, 90)
    points, looked = face
    replace(found, cameras=boxes).save(tmp_path / "capture")
    for _ in range(2):
        capture, figures = prepare.prepare_capture(tmp_path / "capture", CalibrateConfig(),
                                                   keep_background=True)
        assert np.array_equal(capture.landmarks, points)
        assert figures["landmarks"] == {"views": 5, "error_px": 0.7}
    assert looked == [COUNT]


def test_a_face_is_found_without_moving_the_frame(monkeypatch, face):
    found, _, _ = photos(0.0, 90)
    points, looked = face
    monkeypatch.setattr("lfportrait.models.missing", lambda names: [])
    faced = find_face(found)
    assert np.array_equal(faced.landmarks, points) and faced.cameras is found.cameras
    assert find_face(faced) is faced and looked == [COUNT]


def test_without_its_network_no_face_is_looked_for(monkeypatch):
    found, _, _ = photos(0.0, 90)
    monkeypatch.setattr("lfportrait.models.missing", lambda names: list(names))
    with pytest.warns(UserWarning, match="models fetch face-landmarker"):
        assert find_face(found) is found


def test_a_capture_is_turned_into_the_frame_of_its_face_when_asked(monkeypatch, face):
    found, _, _ = photos(0.0, 90)
    points, _ = face
    turned = find_face(found, reframe=True)
    straight = portrait_frame_from_landmarks(turned.landmarks, turned.cameras)
    assert np.allclose(straight, np.eye(4), atol=1e-6)
    # What the cameras show stays where it is.
    before, _ = found.cameras.project(points)
    after, _ = turned.cameras.project(turned.landmarks)
    assert np.allclose(before, after, atol=1e-6)
    # One that knows its face already is turned, too, and once is enough.
    again = find_face(find_face(found), reframe=True)
    assert np.allclose(again.landmarks, turned.landmarks)
    assert find_face(again, reframe=True).cameras is again.cameras


def test_no_portrait_frame_without_a_face(monkeypatch):
    found, _, _ = photos(0.0, 90)
    monkeypatch.setattr("lfportrait.face.landmarks_of_capture",
                        lambda capture, progress=None: (None, {"views": 1}))
    monkeypatch.setattr("lfportrait.job.prepare.kept_arrays", lambda name, key, find: find())
    with pytest.raises(UserError, match="leave out --portrait-frame"):
        find_face(found, reframe=True)


@pytest.mark.usefixtures("face")
@pytest.mark.parametrize("helps", [True, False])
def test_photos_that_share_nothing_are_placed_by_the_face(tmp_path, monkeypatch, helps):
    found, _, boxes = photos(0.0, 90)

    def apart(*_, **__):
        raise PhotosError("the photos do not overlap enough", {})
    monkeypatch.setattr(prepare, "calibrate", apart)
    monkeypatch.setattr(prepare, "read_source", lambda *_: [])
    monkeypatch.setattr("lfportrait.models.missing", lambda names: [])
    by_face = replace(found, cameras=boxes, figures={"photos": COUNT, "left_out": ["7.png"],
                                                     "blurred": [], "placed": "by the face"})
    monkeypatch.setattr("lfportrait.face.capture_from_faces",
                        lambda path, config, progress: by_face if helps else None)
    if not helps:
        with pytest.raises(UserError, match="do not overlap enough"):
            prepare.prepare_capture(tmp_path, CalibrateConfig(), keep_background=True)
        return
    with pytest.warns(UserWarning, match=r"1 photos could not be placed by the face .*7\.png"):
        capture, figures = prepare.prepare_capture(tmp_path, CalibrateConfig(),
                                                   keep_background=True, need_face=True)
    assert figures["calibration"]["placed"] == "by the face" and len(capture) == COUNT
    assert capture.landmarks is not None
