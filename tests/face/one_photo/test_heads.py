"""A head in one call, from what programs have of photos."""

import numpy as np
import pytest
from PIL import Image

import lfportrait as lf
from lfportrait.face.one_photo import portrait


@pytest.fixture
def fitted(monkeypatch):
    """Names, sizes and resolution that heads were made of; nothing is fitted."""
    seen = []

    def capture(photos, progress):
        seen.append([(photo.name, photo.image.shape) for photo in photos])
        return "capture", {}

    def field(found, config, progress):
        seen.append((found, config and config.resolution))
        return "field", {}
    monkeypatch.setattr(portrait, "portrait_capture", capture)
    monkeypatch.setattr(portrait, "portrait_field", field)
    return seen


def picture(channels=3, height=20, width=16):
    return np.zeros((height, width, channels), np.uint8)


def test_files_folders_and_pictures_are_taken(tmp_path, fitted):
    for number, name in enumerate(("a.png", "b.png")):
        Image.fromarray(picture() + np.uint8(number)).save(tmp_path / name)
    assert lf.head_from_photos(tmp_path / "a.png") == ("field", "capture")
    lf.head_from_photos(str(tmp_path))
    lf.head_from_photos([tmp_path / "b.png", picture(4)], lf.ReconstructConfig(resolution=90),
                        max_side=10)
    assert fitted == [
        [("a.png", (20, 16, 3))], ("capture", None),
        [("a.png", (20, 16, 3)), ("b.png", (20, 16, 3))], ("capture", None),
        [("b.png", (10, 8, 3)), ("photo 2", (20, 16, 4))], ("capture", 90)]


@pytest.mark.parametrize("given, told", [
    ([], "no photo to make a head of"), (picture(2), r"photo 1 must be uint8 .* \[20, 16, 2\]"),
    ([picture(), np.zeros((20, 16, 3))], "photo 2 must be uint8 .*not float64"),
    ("nowhere.jpg", "nowhere.jpg")])
def test_what_is_no_photo_is_refused(given, told):
    with pytest.raises(lf.UserError, match=told):
        lf.head_from_photos(given)
