"""A photo whose data are gone is named; no sound one ever is."""

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import read_photos
from lfportrait.errors import UserError
from lfportrait.media.kinds import damage_of
from lfportrait.media.pictures import read_image

KINDS = {"baseline": {}, "progressive": {"progressive": True}, "optimized": {"optimize": True},
         "restarts": {"restart_marker_rows": 1}, "4:4:4": {"subsampling": 0, "quality": 97},
         "coarse": {"quality": 15}}


def scene(height=300, width=400):
    rng = np.random.default_rng(2)
    smooth = Image.fromarray(rng.integers(0, 256, (height // 10 + 1, width // 10 + 1, 3), np.uint8))
    image = np.asarray(smooth.resize((width, height), Image.Resampling.BICUBIC)).astype(float)
    return np.clip(image + rng.normal(0, 5, image.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("mode", ["RGB", "L"])
@pytest.mark.parametrize("fill", [b"\0", b"\xff"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_jpeg_that_is_empty_from_a_third_on(tmp_path, kind, fill, mode):
    path = tmp_path / "a.jpg"
    Image.fromarray(scene()).convert(mode).save(path, **KINDS[kind])
    data = path.read_bytes()
    assert not damage_of(path)
    start = len(data) // 3
    for end in (b"", b"\xff\xd9"):
        path.write_bytes(data[:start] + fill * (len(data) - start - len(end)) + end)
        assert "gone from 3" in damage_of(path), (kind, fill, end)
    with pytest.raises(UserError, match=r"damaged.*copy it again"):
        read_image(path)


def test_the_others_of_a_folder_are_taken(tmp_path):
    for name in "abc":
        Image.fromarray(scene()).save(tmp_path / f"{name}.jpg")
        with open(tmp_path / f"{name}.jpg", "ab") as stream:
            stream.write(name.encode())  # no copies of each other
    data = (tmp_path / "b.jpg").read_bytes()
    (tmp_path / "b.jpg").write_bytes(data[:5000] + bytes(len(data) - 5000))
    with pytest.warns(UserWarning, match="b.jpg can't be read and is left out: it is damaged"):
        photos = read_photos(tmp_path)
    assert [photo.name for photo in photos] == ["a.jpg", "c.jpg"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mode", ["RGB", "L", pytest.param("CMYK", marks=pytest.mark.slow)])
def test_flat_pictures_are_sound(tmp_path, kind, mode):
    """Their compressed data are long runs of equal bytes."""
    half = np.concatenate([scene(200, 1600), np.full((1400, 1600, 3), 255, np.uint8)])
    for image in (np.full((1600, 1200, 3), 255, np.uint8), np.zeros((1600, 1200, 3), np.uint8),
                  np.full((1600, 1200, 3), 128, np.uint8), half, np.zeros((1, 1, 3), np.uint8)):
        Image.fromarray(image).convert(mode).save(tmp_path / "a.jpg", **KINDS[kind])
        assert damage_of(tmp_path / "a.jpg") == ""


def test_several_pictures_and_thumbnails_in_a_file_are_sound(tmp_path):
    path = tmp_path / "a.jpg"
    first, second = Image.fromarray(scene()), Image.new("RGB", (400, 300), "white")
    first.save(path, "MPO", save_all=True, append_images=[second])
    assert damage_of(path) == ""
    exif = Image.Exif()
    exif[0x010F] = "x"
    first.save(path, exif=exif.tobytes() + bytes(20_000))  # notes of the maker, empty ones
    assert damage_of(path) == ""
    with open(path, "ab") as stream:  # a phone's film behind the photo, or padding
        stream.write(bytes(50_000))
    assert damage_of(path) == ""
    assert read_image(path).shape == (300, 400, 3)


@pytest.mark.parametrize("suffix", [".webp", ".avif"])
def test_other_compressed_pictures(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (300, 400, 3), np.uint8)).save(path)
    assert damage_of(path) == ""
    data = path.read_bytes()
    assert len(data) > 20_000
    path.write_bytes(data[:len(data) // 3] + bytes(len(data) - len(data) // 3))
    assert "gone from 33 %" in damage_of(path)
    Image.new("RGB", (2000, 1500), "white").save(path)
    assert damage_of(path) == ""


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff", b"\xff\xd8\xff\xe0\0", b"\xff\xd8\xff\xc0"
                                  b"\0\2\xff\xda\0\2", b"\xff\xd8" + b"\xff" * 1000,
                                  b"\xff\xd8\xff\xc4\0\1" + bytes(999)])
def test_what_can_not_be_parsed_is_left_to_the_decoder(tmp_path, data):
    (tmp_path / "a.jpg").write_bytes(data)
    assert isinstance(damage_of(tmp_path / "a.jpg"), str)
    with pytest.raises(UserError, match="can't read the picture"):
        read_image(tmp_path / "a.jpg")
