"""TIFF and PNG files for printers: other programs read them, and half a file never appears."""

import errno
import io

import cv2
import numpy as np
import pytest
from PIL import Image, ImageCms

from lfportrait.errors import UserError
from lfportrait.lightfield.prints import pages
from lfportrait.lightfield.prints.pages import check_file, row_file


def noise(height, width, grey=False, seed=0):
    random = np.random.default_rng(seed)
    if grey:
        return random.integers(0, 65536, (height, width), np.uint16)
    # Rows that are alike, as those of prints.
    return np.cumsum(random.integers(0, 3, (height, width, 3)), 0).astype(np.uint8)


def written(path, picture, band=16, dpi=720.0, **options):
    with row_file(path, picture.shape[1], picture.shape[0], dpi, **options) as rows:
        for first in range(0, len(picture), band):
            rows.write(picture[first:first + band])
    return path


@pytest.mark.parametrize("suffix", [".tiff", ".tif", ".png"])
@pytest.mark.parametrize("height, width, band", [(1, 1, 16), (37, 51, 16), (64, 33, 64),
                                                 (100, 7, 3)])
def test_pillow_and_opencv_read_the_same_pixels(tmp_path, suffix, height, width, band):
    picture = noise(height, width)
    path = written(tmp_path / f"p{suffix}", picture, band, note="60 lpi")
    with Image.open(path) as read:
        assert read.mode == "RGB" and np.array_equal(np.asarray(read), picture)
        assert read.info["dpi"] == pytest.approx((720, 720), rel=1e-4)
        profile = ImageCms.ImageCmsProfile(io.BytesIO(read.info["icc_profile"]))
        assert "sRGB" in ImageCms.getProfileDescription(profile)
    assert np.array_equal(cv2.imread(str(path))[..., ::-1], picture)


@pytest.mark.parametrize("suffix", [".tiff", ".png"])
def test_sixteen_bits_stay(tmp_path, suffix):
    picture = noise(45, 31, grey=True)
    path = written(tmp_path / f"p{suffix}", picture, grey=True)
    assert np.array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), picture)
    with Image.open(path) as read:
        assert "icc_profile" not in read.info and read.mode.startswith("I")


def test_tifffile_finds_a_sound_tiff(tmp_path):
    tifffile = pytest.importorskip("tifffile")
    picture = noise(50, 40)
    with tifffile.TiffFile(written(tmp_path / "p.tiff", picture, dpi=1440.0)) as read:
        page = read.pages[0]
        assert np.array_equal(page.asarray(), picture)
        assert page.tags["XResolution"].value == (1440, 1)
        assert page.tags["ResolutionUnit"].value == 2
        tags = [tag.code for tag in page.tags]
        assert tags == sorted(tags) and page.is_tiled is False


@pytest.mark.parametrize("suffix", [".tiff", ".png"])
def test_half_a_picture_is_no_file(tmp_path, suffix):
    path = tmp_path / f"p{suffix}"
    with pytest.raises(ValueError, match="missing"), row_file(path, 5, 9, 300) as rows:
        rows.write(noise(4, 5))
    with pytest.raises(RuntimeError), row_file(path, 5, 9, 300):
        raise RuntimeError
    with pytest.raises(ValueError, match="fit"), row_file(path, 5, 9, 300) as rows:
        rows.write(noise(9, 6))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name, width, height, message", [
    ("p.jpg", 10, 10, "tiff"), ("p", 10, 10, "tiff"), ("p.webp", 10, 10, "tiff"),
    ("p.tiff", 40000, 40000, "4 GiB")])
def test_formats_that_cannot_hold_it_are_refused(tmp_path, name, width, height, message):
    with pytest.raises(UserError, match=message):
        check_file(tmp_path / name, width, height)


def test_a_full_disk_is_found_before_and_while_writing(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(pages, "free_disk_bytes", lambda folder: 1000)
        for suffix in (".tiff", ".png"):
            with pytest.raises(UserError, match="free some space"):
                check_file(tmp_path / f"p{suffix}", 1000, 1000)
    path = tmp_path / "p.tiff"
    path.write_bytes(b"older")
    with pytest.raises(UserError, match=r"can't write .*space"), row_file(path, 5, 9, 300):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert path.read_bytes() == b"older" and len(list(tmp_path.iterdir())) == 1


def test_a_tiff_that_grows_beyond_its_numbers_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(pages, "_TIFF_MOST", 200)
    monkeypatch.setattr(pages, "check_file", lambda *_, **__: None)
    with pytest.raises(UserError, match="4 GiB"):
        written(tmp_path / "p.tiff", noise(20, 20))
    assert list(tmp_path.iterdir()) == []
