"""What is told of a painting, and which of its faces is meant."""

import numpy as np
import pytest
from PIL import Image

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.face import detect_faces, read_landmarks, write_landmarks
from lfportrait.job import add_style, check_style, style_picture
from lfportrait.stylize import StylizeConfig
from tests.recordings import painting


@pytest.fixture(scope="module")
def exemplar():
    return painting("impression", 240, 320, 30.0)


@pytest.fixture
def picture(exemplar, tmp_path):
    """A painting with its landmarks and mask beside it."""
    path = tmp_path / "lady.png"
    Image.fromarray(exemplar.image).save(path)
    Image.fromarray(np.uint8(exemplar.mask * 255)).save(tmp_path / "lady.mask.png")
    write_landmarks(path.with_suffix(".landmarks.txt"), exemplar.landmarks)
    return path


@pytest.fixture
def drawing(tmp_path):
    """Draws a face turned by so many degrees."""
    def draw(turn):
        drawn = painting("charcoal", 240, 320, turn)
        path = tmp_path / "drawn.png"
        Image.fromarray(drawn.image).save(path)
        Image.fromarray(np.uint8(drawn.mask * 255)).save(tmp_path / "drawn.mask.png")
        write_landmarks(path.with_suffix(".landmarks.txt"), drawn.landmarks)
        return path

    return draw


@pytest.fixture
def two_faces(exemplar, tmp_path, monkeypatch):
    """A painting of two, a large face on the left and a small one on the right, and a detector."""
    small = np.asarray(Image.fromarray(exemplar.image).resize((120, 160)))
    image = np.full((320, 360, 3), 128, np.uint8)
    image[:, :240] = exemplar.image
    image[:160, 240:] = small
    path = tmp_path / "two.png"
    Image.fromarray(image).save(path)
    faces = [exemplar.landmarks, exemplar.landmarks / 2 + [240, 0]]

    def detect(crop, most=1):
        # Crops are views of the picture: where they lie in it follows from their first pixel.
        start = crop.__array_interface__["data"][0] - base["data"]
        y0, x0 = divmod(start // 3, 360)
        height, width = crop.shape[:2]
        inside = [points - [x0, y0] for points in faces
                  if (points.min(axis=0) >= [x0, y0]).all()
                  and (points.max(axis=0) <= [x0 + width, y0 + height]).all()]
        return inside[:most]

    base = {}

    def detect_whole(image, *args, **options):
        base["data"] = image.__array_interface__["data"][0]
        return detect_faces(image, *args, **options)

    monkeypatch.setattr("lfportrait.face.detect._meshes", detect)
    monkeypatch.setattr("lfportrait.face.detect._second_opinion", lambda image, points: points)
    monkeypatch.setattr("lfportrait.job.style_check.detect_faces", detect_whole)
    return path, faces, detect_whole


def test_a_turned_painting_is_told_and_drawn(picture):
    check = check_style(picture, preview=False)
    said = " ".join(text for _, text in check.facts)
    assert "degrees to the picture's right" in said and "frontal picture" in said
    assert check.figures["mirrored"]["side"] == "right"
    assert {"cheek", "ear"} <= set(check.figures["mirrored"]["parts"])
    assert check.figures["rows_shown"]["generic-8k"] > check.figures["rows_shown"]["generic-4k"]
    assert check.frontal.shape == check.exemplar.image.shape and check.preview is None
    page = style_picture(check)
    assert page.dtype == np.uint8 and page.shape[1] == 1680
    # The mesh is drawn, in its own color.
    assert (np.abs(page.astype(int) - [0, 200, 255]).max(axis=-1) < 8).sum() > 300


def test_a_frontal_drawing_is_taken_as_it_is(drawing):
    check = check_style(drawing(0.0), preview=False)
    assert check.frontal is None and "used unchanged" in check.facts[0][1]
    assert any("Drawn in one color" in text for _, text in check.facts)


def test_a_profile_is_told(drawing):
    check = check_style(drawing(75.0))
    assert "nearly a profile" in check.facts[0][1]
    assert check.preview is None and check.frontal is None
    assert style_picture(check).shape[1] == 1680


@pytest.mark.slow  # painted in tests/stylize, too
def test_the_preview_shows_the_embedded_head_in_the_paintings_colors(picture, exemplar,
                                                                     monkeypatch):
    # A fourth of its skin's pixels are enough to tell the colors.
    monkeypatch.setattr("lfportrait.job.style_check.StylizeConfig", lambda **given: StylizeConfig(
        **{**given, "pixels": 0.5 * given["pixels"]}))
    check = check_style(picture)
    assert check.preview.shape[1] == 3 * check.preview.shape[0]
    assert {"skin", "hair"} <= set(check.figures["materials"])
    middle = check.preview[:, check.preview.shape[0]:2 * check.preview.shape[0]]
    face = middle[230:300, 250:310].reshape(-1, 3).mean(axis=0)
    low, high = exemplar.landmarks[[31, 35]].mean(axis=0).astype(int), 20
    painted = exemplar.image[low[1] - high:low[1], low[0] - high:low[0] + high]
    assert np.abs(face - painted.reshape(-1, 3).mean(axis=0)).max() < 45
    assert (middle[:20] > 245).all()


def test_faces_are_numbered_by_size_and_found_by_a_place(two_faces):
    path, faces, detect = two_faces
    image = np.ascontiguousarray(np.asarray(Image.open(path)))
    found = detect(image)
    assert len(found) == 2
    assert all(np.abs(one - other).max() < 1e-9 for one, other in zip(found, faces, strict=True))
    place = tuple(faces[1][30])
    near = detect(image, place)
    assert len(near) == 1 and np.abs(near[0] - faces[1]).max() < 1e-9
    assert detect(image, (355.0, 310.0)) == []


@pytest.mark.slow  # faces are found and numbered above
def test_another_face_is_added_and_checked_by_its_number(two_faces, capsys):
    path, faces, _ = two_faces
    said = add_style(path, face=2)
    assert said["faces"] == 2
    beside = path.with_suffix(".landmarks.txt")
    assert np.abs(read_landmarks(beside) - faces[1]).max() < 0.01
    assert path.with_suffix(".landmarks.png").exists()
    with pytest.raises(UserError, match="already exists; remove it"):
        add_style(path, face=1)
    beside.unlink()
    with pytest.raises(UserError, match="shows 2 faces; there is no face 3"):
        check_style(path, face=3, preview=False)
    check = check_style(path, face=2, preview=False)
    assert any("2 faces: this is number 2" in text for _, text in check.facts)
    with pytest.raises(UserError, match="no face found at 355 310"):
        add_style(path, at=(355.0, 310.0))
    assert not beside.exists()


def test_the_command_writes_the_page(picture, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("lfportrait.job.style_check._paint", lambda check: None)
    assert main(["styles", "check", str(picture)]) == 0
    assert picture.with_suffix(".check.png").exists()
    out = capsys.readouterr()
    assert "degrees to the picture's right" in out.out
    with pytest.raises(SystemExit) as stopped:
        main(["styles", "check"])
    assert stopped.value.code == 2 and "The painting" in capsys.readouterr().err
    assert main(["styles", "check", str(tmp_path / "none.png")]) == 2
    assert "none.png" in capsys.readouterr().err
