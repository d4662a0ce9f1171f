"""What `capture-check` finds: blur, gaps in the arc, light that changes."""

import functools
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageFilter

from lfportrait.capture import Camera
from lfportrait.cli import main
from lfportrait.face import face_pose
from lfportrait.files import own_output, write_image
from lfportrait.job import check_photos, check_picture
from lfportrait.job.graph import source_files
from lfportrait.job.photo_check import contact_sheet, problem_sheet


@pytest.fixture(scope="module")
def head() -> np.ndarray:
    """Landmarks [68, 3] of a head in the portrait frame."""
    from lfportrait.demo import demo_landmarks

    return demo_landmarks()


def seen_from(head: np.ndarray, yaw: float, pitch: float = 0.0) -> np.ndarray:
    camera = Camera.arc(np.array([yaw]), distance=5.0, width=640, height=480, focal=760,
                        pitch=pitch)
    return camera.project(head)[0][0]


@pytest.mark.parametrize("yaw", [
    -60, 0, 50, *(pytest.param(yaw, marks=pytest.mark.slow) for yaw in (-30, 25))])
def test_the_side_from_which_a_face_is_seen(head, yaw):
    # From the person's left one sees a face that is turned to the picture's left.
    assert -face_pose(seen_from(head, yaw)).yaw == pytest.approx(yaw, abs=2 + 0.15 * abs(yaw))
    below, above = (-face_pose(seen_from(head, yaw, pitch)).pitch for pitch in (-15, 15))
    # Further round, a landmark's own depth weighs as much as the camera's height.
    assert abs(yaw) > 30 or above - below == pytest.approx(30, abs=8)


@functools.cache
def ground() -> np.ndarray:
    """Corners at many scales. Not to be changed."""
    random = np.random.default_rng(5)
    picture = np.zeros((240, 320, 3))
    for cell in (40, 8, 2):
        picture += np.kron(random.uniform(0, 80, (240 // cell, 320 // cell, 3)),
                           np.ones((cell, cell, 1)))
    return picture


@functools.cache
def disc() -> np.ndarray:
    """The face's pixels. Not to be changed."""
    y, x = np.mgrid[:240, :320]
    return np.hypot(y - 120, x - 160) < 140


def photo(index: int) -> Image.Image:
    """A face-colored disc in front of corners at many scales."""
    picture = np.roll(ground(), 3 * index, 1)
    picture[disc()] = 0.05 * picture[disc()] + (140, 100, 80)
    return Image.fromarray(picture.astype(np.uint8))


@pytest.fixture
def faces(monkeypatch, head):
    """A detector that finds the face of photo N at N's angle, by the number that its size tells."""
    angles: dict[int, float] = {}

    def detect(image, *, turns=(0,), thorough=True):
        yaw = angles.get(int(image[0, 0, 0]))
        return None if yaw is None or turns != (0,) else seen_from(head, yaw) / 2

    monkeypatch.setattr("lfportrait.job.photo_check._can_see_faces", lambda: True)
    monkeypatch.setattr("lfportrait.job.photo_check.detect_landmarks", detect)
    return angles


def series(folder: Path, faces: dict[int, float], yaws: list[float], change=lambda i, p: p) -> Path:
    folder.mkdir()
    for index, yaw in enumerate(yaws):
        picture = np.array(change(index, photo(index)))
        picture[0, 0] = index
        faces[index] = yaw
        Image.fromarray(picture).save(folder / f"{index:03d}.png", compress_level=1)
    return folder


def test_photos_that_are_well(tmp_path, faces):
    check = check_photos(series(tmp_path / "photos", faces, list(range(-60, 61, 5))))
    assert check.advice == []
    assert check.gaps == []
    assert not any(one.wrong or one.fair for one in check.photos)
    assert [one.yaw for one in check.photos] == pytest.approx(list(range(-60, 61, 5)), abs=9)


def test_a_gap_a_missing_side_and_few_photos(tmp_path, faces):
    check = check_photos(series(tmp_path / "photos", faces, [-50, -42, -35, 0, 5, 10]))
    text = " ".join(check.advice)
    assert len(check.gaps) == 1
    assert check.gaps[0] == pytest.approx((-35, 0), abs=6)
    assert "There are no photos between" in text and "degrees to the left and the front" in text
    assert "degrees to the right; go on" in text
    assert "6 usable photos are too few" in text


@pytest.mark.slow  # photos that are well, and gaps: above
def test_blur_and_light_that_changes(tmp_path, faces):
    def change(index, picture):
        if index == 4:
            return picture.filter(ImageFilter.GaussianBlur(4))
        if index in (8, 13, 17):
            return picture.point(lambda value: int(0.6 * value))
        return picture

    check = check_photos(series(tmp_path / "photos", faces, list(range(-50, 51, 5)), change))
    assert [one.name for one in check.photos if one.wrong] == ["004.png"]
    darker = [one.name for one in check.photos if "darker" in one.fair]
    assert darker == ["008.png", "013.png", "017.png"]
    text = " ".join(check.advice)
    assert "blurred: 004.png" in text
    assert "lock the exposure" in text and "017.png" in text


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (800, 2)])
def test_pictures_of_hardly_a_pixel_are_useless_and_their_figures_are_numbers(
        tmp_path, faces, size):
    folder = series(tmp_path / "photos", faces, [-10, 0, 10])
    Image.new("RGB", size, "red").save(folder / "icon.png")
    check = check_photos(folder)
    assert [one.name for one in check.photos if one.wrong] == ["icon.png"]
    assert any("too few pixels: icon.png" in one for one in check.advice)
    json.dumps(check.figures(), allow_nan=False)


def test_the_picture_shows_each_photo_and_the_gap(tmp_path, faces):
    check = check_photos(series(tmp_path / "photos", faces, [-50, -42, -35, 0, 5, 10]))
    picture = check_picture(check)
    assert picture.dtype == np.uint8 and picture.shape[1] >= 1200
    # The gap is red from above, and a set without it is not.
    red = (np.abs(picture[:460, :720].astype(int) - (196, 52, 44)).sum(-1) < 30).sum()
    check.gaps = []
    plain = check_picture(check)
    assert red > 300 > (np.abs(plain[:460, :720].astype(int) - (196, 52, 44)).sum(-1) < 30).sum()


def test_a_sheet_marks_what_is_wrong():
    images = [np.full((60, 80, 3), 128, np.uint8)] * 3
    plain = contact_sheet(images, ["a", "b", "c"], {})
    marked = contact_sheet(images, ["a", "b", "c"], {"b": "blurred"})
    changed = np.flatnonzero((plain != marked).any((0, 2)))
    assert plain.shape == marked.shape
    third = plain.shape[1] / 3
    assert third - 5 < changed.min() and changed.max() < 2 * third + 10


def test_capture_check_as_a_command(tmp_path, faces, capsys):
    folder = series(tmp_path / "photos", faces, [-50, -42, -35, 0, 5, 10])
    out, figures = tmp_path / "check.png", tmp_path / "check.json"
    assert main(["capture-check", str(folder), "--out", str(out), "--json", str(figures)]) == 0
    printed = capsys.readouterr().out
    assert "6 photos, 6 usable" in printed and "- There are no photos between" in printed
    assert Image.open(out).width > 1000
    data = json.loads(figures.read_text())
    assert data["count"] == data["faces"] == 6
    assert data["photos"][3]["name"] == "003.png"
    assert data["seconds"]["wall"] + 0.01 > data["seconds"]["check"] > 0


# The name that others are least like.
@pytest.mark.parametrize("name", [
    "check.jpg", pytest.param("capture-check.png", marks=pytest.mark.slow),
    pytest.param("check.png", marks=pytest.mark.slow)])
def test_its_own_picture_is_no_photo_the_second_time(tmp_path, faces, monkeypatch, name):
    for number in range(4):
        write_image(tmp_path / f"{number}.jpg", np.full((64, 48, 3), 60 * number, np.uint8))
    before = source_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    counts = []
    for _ in range(2):
        figures = tmp_path.parent / "figures.json"
        assert main(["capture-check", ".", "--out", name, "--json", str(figures), "--quiet"]) == 0
        counts.append(json.loads(figures.read_text())["count"])
    assert counts == [4, 4] and (tmp_path / name).is_file()
    assert source_files(tmp_path) == before  # nor do cameras found before become stale


def test_pictures_are_photos_unless_they_are_sheets(tmp_path):
    image = np.full((40, 40, 3), 90, np.uint8)
    for name in ("a.png", "a.jpg", "a.webp"):
        write_image(tmp_path / name, image)
        assert not own_output(tmp_path / name)
    for name in ("a.png", "a.jpg"):
        write_image(tmp_path / name, image, sheet=True)
        assert own_output(tmp_path / name)
    assert not own_output(tmp_path / "missing.png")


@pytest.mark.parametrize("words, message", [
    (["nowhere"], "nowhere"), (["photos", "--out", "check.txt"], "must end in")])
def test_mistakes_are_told_in_one_line(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "photos").mkdir()
    assert main(["capture-check", *words]) == 2
    error = [line for line in capsys.readouterr().err.splitlines() if line.startswith("lfport")]
    assert len(error) == 1 and message in error[0]
    assert [path.name for path in tmp_path.iterdir()] == ["photos"]


def test_photos_that_can_not_be_placed_are_shown(tmp_path, capsys):
    noise = np.random.default_rng(0).integers(0, 256, (4, 120, 160, 3), dtype=np.uint8)
    for number, image in enumerate(noise):
        write_image(tmp_path / "photos" / f"{number}.png", image)
    assert main(["calibrate", str(tmp_path / "photos"), "--out", str(tmp_path / "out"),
                 "--quiet"]) == 2
    assert "out-photos.jpg" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    sheet = np.asarray(Image.open(tmp_path / "out-photos.jpg"))
    problem_sheet(tmp_path / "photos", {}, tmp_path / "plain.png")
    assert sheet.shape == np.asarray(Image.open(tmp_path / "plain.png")).shape


def test_what_is_left_out_and_what_differs_are_notes(tmp_path, faces):
    folder = series(tmp_path / "photos", faces, [-10, 0, 10])
    (folder / "raw.nef").write_bytes(b"II*\0" + bytes(64))
    Image.new("RGB", (300, 200), "red").save(folder / "other.png")
    notes = check_photos(folder).notes
    assert any("raw.nef" in note and "raw photos" in note for note in notes)
    assert any("differ in size" in note and "other.png" in note for note in notes)
    assert check_photos(series(tmp_path / "even", faces, [-10, 0, 10])).notes == []
