"""Which networks a job asks for before its first long stage, and what goes on without."""

import json

import numpy as np
import pytest

from lfportrait import models
from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.files import write_image
from lfportrait.job.pipeline import get_networks, networks_of
from lfportrait.job.warmup import ball_capture
from tests.portraits import drawn_face

FACE, PERSON, HAIR = "face-landmarker", "person-segmentation", "hair-segmentation"


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """A machine without networks, and nowhere to get them."""
    monkeypatch.delenv("LFPORTRAIT_MODELS", raising=False)
    monkeypatch.setenv("LFPORTRAIT_MIRROR", "http://127.0.0.1:9")
    monkeypatch.setattr(models, "cache_folder", lambda: tmp_path / "cache")
    monkeypatch.setattr(models, "PAUSE", 0.0)


@pytest.fixture
def painting(tmp_path):
    """A painting with its landmarks beside it."""
    from lfportrait.face import write_landmarks

    face = drawn_face(120, 90)
    write_image(tmp_path / "painting.png", face.image)
    write_landmarks(tmp_path / "painting.landmarks.txt", face.landmarks)
    return tmp_path / "painting.png"


def photos(folder, channels, suffix=".jpg"):
    folder.mkdir()
    for number in range(3):
        write_image(folder / f"{number}{suffix}",
                    np.full((20, 30, channels), 128 + number, np.uint8))
    return folder


def test_plain_photos_need_faces_and_mattes(tmp_path, painting):
    needed, better = networks_of(photos(tmp_path / "photos", 3), painting, False)
    assert needed == [FACE, PERSON]
    assert better == [HAIR]


def test_a_room_that_stays_needs_no_mattes(tmp_path, painting):
    assert networks_of(photos(tmp_path / "photos", 3), painting, True)[0] == [FACE]


def test_photos_that_are_cut_out_need_no_mattes(tmp_path, painting):
    folder = photos(tmp_path / "photos", 4, ".png")
    assert networks_of(folder, painting, False) == ([FACE], [PERSON, HAIR])


def test_a_damaged_photo_is_passed_over(tmp_path, painting):
    folder = photos(tmp_path / "photos", 4, ".png")
    (folder / "0.png").write_bytes(b"torn")
    assert networks_of(folder, painting, False)[0] == [FACE]


def test_a_data_set_with_masks_needs_no_mattes(tmp_path, painting):
    folder = photos(tmp_path / "photos", 3)
    (folder / "masks").mkdir()
    assert networks_of(folder, painting, False)[0] == [FACE]


def test_a_capture_that_knows_all_needs_nothing(tmp_path, painting):
    ball_capture().save(tmp_path / "capture")
    assert networks_of(tmp_path / "capture", painting, False) == ([], [PERSON, HAIR])
    assert networks_of(tmp_path / "capture", None, False)[0] == []
    painting.with_suffix(".landmarks.txt").unlink()
    assert networks_of(tmp_path / "capture", painting, False)[0] == [FACE]


def test_all_that_is_missing_is_told_at_once(tmp_path, painting, empty):
    folder = photos(tmp_path / "photos", 3)
    with pytest.raises(UserError, match=r"needs 3 networks \(5 MB\).*models fetch portrait"):
        get_networks(folder, painting, False, offline=True, quiet=True)


def test_what_only_makes_it_better_is_done_without_and_told(tmp_path, painting, empty, capsys):
    ball_capture().save(tmp_path / "capture")
    get_networks(tmp_path / "capture", painting, False, offline=True, quiet=False)
    said = capsys.readouterr().err
    assert "continuing without" in said and said.count("\n") == 1
    get_networks(tmp_path / "capture", painting, False, offline=False, quiet=True)
    assert capsys.readouterr().err == ""


def test_the_networks_of_a_method_are_asked_for_first(tmp_path, painting, empty, capsys):
    ball_capture().save(tmp_path / "capture")
    code = main(["make", str(tmp_path / "capture"), "--style", str(painting), "--out",
                 str(tmp_path / "out"), "--offline", "--stylize.method", "stylized-nerf"])
    said = capsys.readouterr().err
    assert code == 2 and "models fetch adain" in said and said.count("\n") == 1
    assert not (tmp_path / "out" / "field.npz").exists()


def test_make_asks_before_anything_is_made(tmp_path, painting, empty, capsys):
    folder = photos(tmp_path / "photos", 3)
    code = main(["make", str(folder), "--style", str(painting), "--out", str(tmp_path / "out"),
                 "--offline"])
    assert code == 2
    assert "lfportrait models fetch portrait" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_damaged_description_is_no_reason_to_fail_here(tmp_path, painting):
    folder = photos(tmp_path / "photos", 3)
    (folder / "transforms.json").write_text(json.dumps({"frames": []}))
    assert FACE in networks_of(folder, painting, False)[0]
