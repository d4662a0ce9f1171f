"""What a file is, its content says, whatever its name says."""

import io
import warnings

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import read_photos
from lfportrait.errors import UserError
from lfportrait.media.kinds import file_format, kind_of
from lfportrait.media.pictures import read_image

COLOR = (200, 120, 40)


def encoded(kind, **options):
    if kind == "heif":
        pytest.importorskip("pillow_heif").register_heif_opener()
    stream = io.BytesIO()
    Image.new("RGB", (32, 24), COLOR).save(stream, kind, **options)
    return stream.getvalue()


@pytest.mark.parametrize("kind", ["jpeg", "png", "gif", "tiff", "bmp", "webp", "heif", "avif"])
@pytest.mark.parametrize("name", ["a.JPG", "a.jpg", "a", "a.png", "a.mp4", "a.heic", "photo.1"])
def test_pictures_of_any_name(tmp_path, kind, name):
    path = tmp_path / name
    path.write_bytes(encoded(kind))
    assert kind_of(path) == "picture"
    assert file_format(path) == {"heif": "heic"}.get(kind, kind)
    found = read_image(path)
    assert found.shape == (24, 32, 3) and np.abs(found[9, 9].astype(int) - COLOR).max() < 8
    assert [photo.name for photo in read_photos(tmp_path)] == [name]


def boxed(brand, *others):
    brands = brand + b"\0\0\0\0" + b"".join(others)
    return (8 + len(brands)).to_bytes(4, "big") + b"ftyp" + brands + b"\0\0\0\x10mdat" + bytes(8)


@pytest.mark.parametrize(("data", "kind", "form"), [
    (boxed(b"isom", b"avc1"), "video", "mp4"), (boxed(b"qt  "), "video", "mp4"),
    (boxed(b"mp42", b"mif1"), "video", "mp4"), (boxed(b"heic", b"mif1"), "picture", "heic"),
    (boxed(b"mif1", b"heic"), "picture", "heic"), (boxed(b"mif1", b"avif"), "picture", "avif"),
    (boxed(b"avif", b"mif1"), "picture", "avif"), (boxed(b"crx "), "raw", "raw"),
    (b"\0\0\0\x08wide\0\0\0\x10mdat", "video", "mp4"), (b"\x1aE\xdf\xa3" + bytes(60), "video",
                                                         "matroska"),
    (b"RIFF\0\0\0\0AVI LIST", "video", "avi"), (b"RIFF\0\0\0\0WAVEfmt ", "other", ""),
    ((b"\x47" + bytes(187)) * 4, "video", "mpegts"),
    ((bytes(4) + b"\x47" + bytes(187)) * 4, "video", "mpegts"),
    (b"FUJIFILMCCD-RAW 0201", "raw", "raw"), (b"8BPS\0\1", "unread", "psd"),
    (b"%PDF-1.7", "unread", "pdf"), (b"\0\5\x16\7\0\2\0\0", "other", "appledouble"),
    (b"some words", "other", ""), (b"", "other", ""), (b"BM are the first letters", "other", "")])
def test_first_bytes(tmp_path, data, kind, form):
    path = tmp_path / "a.bin"
    path.write_bytes(data)
    assert (kind_of(path), file_format(path)) == (kind, form)


@pytest.mark.parametrize(("name", "kind"), [
    ("a.jpg", "picture"), ("a.HEIC", "picture"), ("a.MOV", "video"), ("a.dng", "raw"),
    ("a.PSD", "unread"), ("a.txt", "other"), ("a", "other")])
def test_damaged_files_are_what_their_ending_names(tmp_path, name, kind):
    (tmp_path / name).write_bytes(bytes(100))
    assert kind_of(tmp_path / name) == kind


def test_folders_and_missing_files(tmp_path):
    (tmp_path / "a.jpg").mkdir()
    assert kind_of(tmp_path / "a.jpg") == "other"
    assert kind_of(tmp_path / "none") == "other" and file_format(tmp_path / "none") == ""


def test_a_text_named_as_a_photo_is_named_as_no_picture(tmp_path):
    (tmp_path / "b.jpg").write_text("<html>not found</html>")
    with pytest.raises(UserError, match=r"can't read the picture .*b\.jpg") as told:
        read_image(tmp_path / "b.jpg")
    assert "\n" not in str(told.value)
    (tmp_path / "a.jpg").write_bytes(encoded("jpeg"))
    with pytest.warns(UserWarning, match="b.jpg can't be read and is left out"):
        assert [photo.name for photo in read_photos(tmp_path)] == ["a.jpg"]


@pytest.mark.parametrize("data", [b"\xff\x0a" + bytes(50), b"8BPS" + bytes(50)])
def test_kinds_that_are_not_read_are_one_line_that_says_so(tmp_path, data):
    (tmp_path / "b.jpg").write_bytes(data)
    with pytest.raises(UserError, match="not read; export it as JPEG"):
        read_image(tmp_path / "b.jpg")
    (tmp_path / "a.jpg").write_bytes(encoded("jpeg"))
    with pytest.warns(UserWarning, match="b.jpg") as told:
        read_photos(tmp_path)
    assert len(told) == 1 and "not read" in str(told[0].message)


def test_apples_shadow_of_a_photo_is_nothing(tmp_path):
    (tmp_path / "a.jpg").write_bytes(encoded("jpeg"))
    (tmp_path / "._a.jpg").write_bytes(b"\0\5\x16\7" + bytes(100))
    (tmp_path / "b.jpg").write_bytes(b"\0\5\x16\7" + bytes(100))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert [photo.name for photo in read_photos(tmp_path)] == ["a.jpg"]
