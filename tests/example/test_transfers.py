"""``transfer`` of photos, folders and videos, regions in their own way, and ``styles add``."""

import importlib

import numpy as np
import pytest
from scipy.ndimage import shift as moved

from lfportrait.capture import video_frames
from lfportrait.cli import main
from lfportrait.example import Transfer, VideoTransfer, mix_regions
from lfportrait.example.guides.regions import find_regions
from lfportrait.face import read_landmarks, write_landmarks
from lfportrait.files import write_image
from lfportrait.labels import PICTURE_LABELS as LABELS
from lfportrait.labels import read_value
from lfportrait.media.pictures import read_image
from lfportrait.share import write_video
from tests.portraits import drawn_face

transfers = importlib.import_module("lfportrait.cli.stylization")
motion_module = importlib.import_module("lfportrait.example.video")


@pytest.fixture
def photo(monkeypatch):
    """A drawn face; its landmarks are what any detector finds."""
    face = drawn_face(160, 120)
    monkeypatch.setattr(transfers, "face_landmarks", lambda image: face.landmarks)
    monkeypatch.setattr("lfportrait.face.detect_landmarks",
                        lambda image, **options: face.landmarks.copy())
    monkeypatch.setattr("lfportrait.job.style_check.detect_faces",
                        lambda image, near=None: [face.landmarks.copy()])
    monkeypatch.setattr("lfportrait.cli.stylization.detect_landmarks",
                        lambda image: face.landmarks.copy())
    return face


@pytest.fixture
def style(tmp_path):
    """Another drawn face with its landmarks beside it."""
    face = drawn_face(160, 120, seed=3, skin=(90, 150, 200), hair=(200, 60, 20))
    write_image(tmp_path / "style.png", face.image)
    write_landmarks(tmp_path / "style.landmarks.txt", face.landmarks)
    return tmp_path / "style.png"


def test_a_region_gets_its_own_exemplar():
    face = drawn_face(160, 120)
    blue, red = np.zeros((160, 120, 3), np.float32), np.zeros((160, 120, 3), np.float32)
    blue[..., 2] = red[..., 0] = 1
    out = mix_regions(face.image, face.landmarks, blue,
                      [read_value("hair", "red"), read_value("background", "off")], {"red": red})
    labels = find_regions(face.image, face.landmarks).labels()
    hair, skin, ground = (labels[..., LABELS.index(name)] > 250
                          for name in ("hair", "skin", "background"))
    assert hair.any() and skin.any() and ground.any()
    assert np.abs(out[hair] - (1, 0, 0)).max() < 0.05
    assert np.abs(out[skin] - (0, 0, 1)).max() < 0.05
    assert np.abs(out[ground] - face.image[ground] / 255).max() < 0.05


def test_necks_and_ears_are_regions_of_a_photo():
    """They are told apart as a painter tells them; together they are the body and the skin."""
    face = drawn_face(160, 120)
    red = np.zeros((160, 120, 3), np.float32)
    red[..., 0] = 1
    def painted(*names):
        choices = [read_value(name, "red") for name in names]
        out = mix_regions(face.image, face.landmarks, face.image / np.float32(255), choices,
                          {"red": red})
        return np.abs(out - face.image / 255).sum(-1)

    neck, clothes, body = painted("neck"), painted("clothes"), painted("body")
    assert body.max() > 0.5 and (body - np.maximum(neck, clothes) > -1e-3).all()
    assert np.abs(painted("features") - painted("brows", "eyes", "nose", "lips")).max() < 0.1
    skin, ears = painted("skin"), painted("ears")
    assert skin.max() > 0.5 and ears.mean() < skin.mean()


@pytest.mark.slow  # a picture and a video are carried over, too
def test_folder(tmp_path, photo, style, capsys):
    for name in ("b", "a"):
        write_image(tmp_path / "in" / f"{name}.jpg", photo.image)
    assert main(["transfer", str(tmp_path / "in"), "--style", str(style), "--out",
                 str(tmp_path / "out"), "--region", "lips=off", "--quiet"]) == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["a.png", "b.png"]
    assert main(["transfer", str(tmp_path / "in"), "--style", str(style), "--out",
                 str(tmp_path / "out.png"), "--quiet"]) == 2
    (tmp_path / "empty").mkdir()
    assert main(["transfer", str(tmp_path / "empty"), "--style", str(style), "--out",
                 str(tmp_path / "out"), "--quiet"]) == 2


def test_video_keeps_its_frames(tmp_path, photo, style):
    write_video(tmp_path / "in.mp4", [photo.image] * 5, 12.0)
    assert main(["transfer", str(tmp_path / "in.mp4"), "--style", str(style), "--out",
                 str(tmp_path / "out.mp4"), "--quiet"]) == 0
    rate, frames = video_frames(tmp_path / "out.mp4")
    frames = list(frames)
    assert rate == pytest.approx(12.0) and len(frames) == 5
    assert np.abs(frames[4].astype(float) - frames[1]).mean() < 3
    assert main(["transfer", str(tmp_path / "in.mp4"), "--style", str(style), "--out",
                 str(tmp_path / "out.png"), "--quiet"]) == 2


def _walk(count, step):
    """A face that moves ``step`` pixels a frame to the right and half of it down."""
    face = drawn_face(200, 160)
    noise = np.random.default_rng(1).normal(0, 8, face.image.shape)
    base = np.clip(face.image + moved(noise, (1, 1, 0)), 0, 255)
    for n in range(count):
        by = np.array([step * n, 0.5 * step * n])
        yield (np.uint8(moved(base, (by[1], by[0], 0), order=1, mode="nearest")),
               face.landmarks + by)


def test_strokes_are_carried_along():
    pytest.importorskip("cv2")
    style = drawn_face(200, 160, seed=5, skin=(90, 150, 200), hair=(200, 60, 20))
    grain = np.random.default_rng(2).normal(0, 40, style.image.shape)
    style.image = np.uint8(np.clip(style.image + grain, 0, 255))
    errors = {}
    for carry in (True, False):
        video = VideoTransfer(Transfer(style), carry)
        for frame, points in _walk(5, 3.0):
            video.apply(frame, points)
        assert len(video.flicker) == 4
        errors[carry] = np.mean(video.flicker)
    assert errors[True] < 0.75 * errors[False]


def test_a_style_is_added_and_corrected(tmp_path, photo, capsys):
    write_image(tmp_path / "own.png", photo.image)
    assert main(["styles", "add", str(tmp_path / "own.png"), "--quiet"]) == 0
    beside = tmp_path / "own.landmarks.txt"
    assert np.allclose(read_landmarks(beside), photo.landmarks, atol=0.01)
    first = read_image(tmp_path / "own.landmarks.png")
    corrected = photo.landmarks.copy()
    corrected[30] += 10
    write_landmarks(beside, corrected)
    assert main(["styles", "add", str(tmp_path / "own.png"), "--quiet"]) == 0
    assert np.allclose(read_landmarks(beside), corrected, atol=0.01)
    assert not np.array_equal(first, read_image(tmp_path / "own.landmarks.png"))
    assert main(["styles", "add", str(tmp_path / "none.png"), "--quiet"]) == 2
    with pytest.raises(SystemExit) as stopped:
        main(["styles", "add"])
    assert stopped.value.code == 2


@pytest.mark.slow  # paintings from the side: tests/job/test_style_check.py
def test_a_photo_from_the_side_is_told(tmp_path, photo, style, monkeypatch, capsys):
    write_image(tmp_path / "in.png", photo.image)
    call = ["transfer", str(tmp_path / "in.png"), "--style", str(style), "--out",
            str(tmp_path / "out.png"), "--quiet"]
    assert main(call) == 0
    assert "degrees" not in capsys.readouterr().err
    monkeypatch.setattr(transfers, "DOUBTFUL", -1.0)
    assert main(call) == 0
    assert "landmarks of its far side are guesses" in capsys.readouterr().err
