"""Pictures of any depth and with any profile are read as sRGB."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image, ImageCms

from lfportrait.capture import read_photos
from lfportrait.errors import UserError
from lfportrait.media.pictures import read_image

COLOR = (200, 60, 60)
P3 = ((0.51512, 0.24120, -0.00105), (0.29198, 0.69225, 0.04189), (0.15710, 0.06657, 0.78407))
ADOBE = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))
SRGB_CURVE = (3, (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))


def profile(primaries, curve=SRGB_CURVE, name="wide"):
    """An ICC profile (version 4) of three primaries, adapted to D50."""
    def fixed(*values):
        return struct.pack(f">{len(values)}i", *(round(value * 65536) for value in values))

    def xyz(values):
        return b"XYZ \0\0\0\0" + fixed(*values)

    def text(words):
        data = words.encode("utf-16-be")
        return b"mluc\0\0\0\0" + struct.pack(">II2s2sII", 1, 12, b"en", b"US", len(data), 28) + data

    kind, parameters = curve
    bend = b"para\0\0\0\0" + struct.pack(">HH", kind, 0) + fixed(*parameters)
    tags = {b"desc": text(name), b"cprt": text("none"), b"wtpt": xyz((0.9642, 1.0, 0.8249)),
            b"rXYZ": xyz(primaries[0]), b"gXYZ": xyz(primaries[1]), b"bXYZ": xyz(primaries[2]),
            b"rTRC": bend, b"gTRC": bend, b"bTRC": bend}
    table, body, start = struct.pack(">I", len(tags)), b"", 132 + 12 * len(tags)
    for tag, data in tags.items():
        data += bytes(-len(data) % 4)
        table += struct.pack(">4sII", tag, start + len(body), len(data))
        body += data
    size = 128 + len(table) + len(body)
    head = struct.pack(">I4sI4s4s4s12s4s4sIIIQI3i", size, b"lcms", 0x04200000, b"mntr", b"RGB ",
                       b"XYZ ", bytes(12), b"acsp", b"APPL", 0, 0, 0, 0, 0,
                       *(round(v * 65536) for v in (0.9642, 1.0, 0.8249)))
    return head.ljust(128, b"\0") + table + body


def saved(path, image, **options):
    Image.fromarray(image).save(path, **options)
    return path


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif"])
def test_a_phones_wide_colors_become_srgb(tmp_path, suffix):
    image = np.full((16, 16, 3), COLOR, np.uint8)
    path = saved(tmp_path / f"p{suffix}", image, icc_profile=profile(P3), quality=100)
    assert np.abs(read_image(path)[8, 8].astype(int) - (217, 42, 52)).max() <= 2
    assert np.abs(read_photos(tmp_path)[0].image[8, 8].astype(int) - (217, 42, 52)).max() <= 2


@pytest.mark.parametrize("primaries", [P3, ADOBE])
def test_colors_are_those_of_littlecms(tmp_path, primaries):
    image = np.random.default_rng(0).integers(0, 256, (20, 30, 3), np.uint8)
    data = profile(primaries, (0, (2.2,)))
    path = saved(tmp_path / "p.png", image, icc_profile=data)
    wanted = ImageCms.profileToProfile(
        Image.fromarray(image), ImageCms.ImageCmsProfile(io.BytesIO(data)),
        ImageCms.createProfile("sRGB"), renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC)
    assert np.array_equal(read_image(path), np.asarray(wanted))
    assert not np.array_equal(read_image(path), image)


def test_transparency_stays(tmp_path):
    image = np.full((8, 8, 4), (*COLOR, 77), np.uint8)
    found = read_image(saved(tmp_path / "p.png", image, icc_profile=profile(P3)))
    assert found.shape == (8, 8, 4) and (found[..., 3] == 77).all()
    assert np.abs(found[0, 0, :3].astype(int) - (217, 42, 52)).max() <= 2


@pytest.mark.parametrize("data", [b"no profile", profile(P3)[:90], profile(P3, name="my sRGB")])
def test_profiles_that_say_nothing_change_nothing(tmp_path, data):
    image = np.full((8, 8, 3), COLOR, np.uint8)
    assert np.array_equal(read_image(saved(tmp_path / "p.png", image, icc_profile=data)), image)


def test_sixteen_bits_and_floating_point_are_the_picture(tmp_path):
    ramp = np.tile(np.linspace(0, 1, 64), (8, 1))
    saved(tmp_path / "a.png", np.uint16(65535 * ramp))
    saved(tmp_path / "b.tif", np.float32(ramp))
    saved(tmp_path / "c.tif", np.int32(65535 * ramp))
    for name in ("a.png", "b.tif", "c.tif"):
        found = read_image(tmp_path / name)
        assert found.shape == (8, 64, 3) and found.dtype == np.uint8
        assert np.abs(found - 255 * ramp[..., None]).max() <= 1, name


def test_grey_palettes_and_print_colors(tmp_path):
    grey = np.tile(np.arange(0, 250, 10, dtype=np.uint8), (8, 1))
    assert np.array_equal(read_image(saved(tmp_path / "l.png", grey))[..., 1], grey)
    Image.fromarray(np.full((8, 8, 3), COLOR, np.uint8)).quantize(4).save(tmp_path / "p.png")
    assert np.abs(read_image(tmp_path / "p.png")[0, 0].astype(int) - COLOR).max() <= 2
    Image.new("CMYK", (8, 8), (0, 255, 255, 0)).save(tmp_path / "c.tif")
    red = read_image(tmp_path / "c.tif")[0, 0].astype(int)
    assert red[0] > 200 and red[1:].max() < 60
    Image.new("LAB", (8, 8), (137, 128, 128)).save(tmp_path / "lab.tif")
    middle = read_image(tmp_path / "lab.tif")[0, 0].astype(int)
    assert np.ptp(middle) <= 2 and 115 < middle[0] < 140


def test_what_is_no_picture_is_one_line(tmp_path):
    (tmp_path / "x.tif").write_bytes(b"II*\0nonsense")
    with pytest.raises(UserError, match="can't read the picture"):
        read_image(tmp_path / "x.tif")


@pytest.mark.parametrize("suffix", [".heic", ".avif"])
def test_a_phones_own_files_have_wide_colors_too(tmp_path, suffix):
    pillow_heif = pytest.importorskip("pillow_heif")
    pillow_heif.register_heif_opener()
    image = np.full((32, 32, 3), COLOR, np.uint8)
    path = saved(tmp_path / f"p{suffix}", image, icc_profile=profile(P3), quality=100)
    for found in (read_image(path), read_photos(tmp_path)[0].image):
        assert np.abs(found[16, 16].astype(int) - (217, 42, 52)).max() <= 4


@pytest.mark.parametrize("suffix", [pytest.param(".jpg", marks=pytest.mark.slow), ".tif"])
def test_photos_of_two_hundred_megapixels_are_read(tmp_path, suffix):
    """Turned by their note as well, which must not be lost on the way."""
    exif = Image.Exif()
    exif[0x0112] = 6
    large = Image.new("L", (16000, 12500), 90)
    large.paste(200, (0, 0, 8000, 12500))
    large.save(tmp_path / f"a{suffix}", exif=exif, quality=50)
    image = read_photos(tmp_path, max_side=400)[0].image
    assert image.shape[0] == 400 and image.shape[1] in (312, 313)
    assert np.abs(image[[100, 300], 150].mean(1) - (200, 90)).max() < 4
    if suffix == ".jpg":
        assert read_image(tmp_path / "a.jpg").shape == (16000, 12500, 3)


def test_a_decompression_bomb_is_one_line(tmp_path):
    chunk = b"IHDR" + struct.pack(">IIBBBBB", 60000, 60000, 8, 2, 0, 0, 0)
    (tmp_path / "bomb.png").write_bytes(
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk
        + struct.pack(">I", zlib.crc32(chunk)) + struct.pack(">I", 0) + b"IDAT"
        + struct.pack(">I", zlib.crc32(b"IDAT")))
    bound = Image.MAX_IMAGE_PIXELS
    with pytest.raises(UserError, match="60000 x 60000 pixels"):
        read_image(tmp_path / "bomb.png")
    assert bound == Image.MAX_IMAGE_PIXELS
    with pytest.warns(UserWarning, match="60000"), pytest.raises(UserError, match="reduce it"):
        read_photos(tmp_path)


def test_raw_photos_are_one_line(tmp_path):
    """Pillow would show the thumbnail of many."""
    saved(tmp_path / "a.tif", np.full((16, 16, 3), COLOR, np.uint8))
    (tmp_path / "a.tif").rename(tmp_path / "a.DNG")
    with pytest.raises(UserError, match="raw photos are not read; export"):
        read_image(tmp_path / "a.DNG")
    with pytest.raises(UserError, match="are raw; export"):
        read_photos(tmp_path)
    saved(tmp_path / "a.jpg", np.full((16, 16, 3), COLOR, np.uint8))
    assert [photo.name for photo in read_photos(tmp_path)] == ["a.jpg"]
    (tmp_path / "a.DNG").rename(tmp_path / "b.nef")
    with pytest.warns(UserWarning, match="raw photos are not read"):
        read_photos(tmp_path)


def test_photos_of_one_folder_deep_below_are_found(tmp_path):
    place = tmp_path / "DCIM" / "100PHONE"
    place.mkdir(parents=True)
    saved(place / "a.jpg", np.full((16, 16, 3), COLOR, np.uint8))
    assert [photo.name for photo in read_photos(tmp_path)] == ["a.jpg"]
    other = tmp_path / "DCIM" / "101PHONE"
    other.mkdir()
    saved(other / "a.jpg", np.full((16, 16, 3), COLOR, np.uint8))
    with pytest.raises(UserError, match="several folders"):
        read_photos(tmp_path)
