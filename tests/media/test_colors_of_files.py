"""What a file says of its colors is heeded, in whichever of many ways it says it."""

import struct
import time
import warnings
import zlib

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import Lens, read_photos, undistort
from lfportrait.media.colors import coded_space, from_space, looks_premultiplied, straight
from lfportrait.media.pictures import file_of, open_picture, read_image

from ..test_colors import P3, profile

ADOBE, ADOBE_SHOWN = (200, 100, 80), (227, 100, 78)
WIDE, WIDE_SHOWN = (200, 60, 60), (217, 42, 52)


def noted(space, index="R03"):
    """EXIF with a color space, and the index of DCF's interoperability."""
    exif = Image.Exif()
    exif[0x010F] = "some camera"
    exif.get_ifd(0x8769)[0xA001] = space
    if index:
        exif.get_ifd(0x8769)[0xA005] = {1: index}
    return exif


def flat(path, color, side=32, **options):
    Image.new("RGB", (side, side), color).save(path, **options)
    return path


def near(image, color, most=2):
    middle = image[image.shape[0] // 2, image.shape[1] // 2, :3].astype(int)
    return np.abs(middle - color).max() <= most


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp"])
def test_adobe_rgb_by_its_note(tmp_path, suffix):
    more = {".webp": {"lossless": True}, ".jpg": {"subsampling": 0, "quality": 100}}.get(suffix, {})
    path = flat(tmp_path / f"a{suffix}", ADOBE, exif=noted(65535), **more)
    for image in (read_image(path), read_photos(tmp_path)[0].image,
                  read_photos(tmp_path, max_side=7)[0].image):
        assert near(image, ADOBE_SHOWN)


def directory(start, *entries):
    """A TIFF directory that begins at a byte: entries are a tag, a type, a count and a value."""
    data = struct.pack("<H", len(entries))
    for tag, kind, count, value in entries:
        packed = value if isinstance(value, bytes) else struct.pack("<I", value)
        data += struct.pack("<HHI", tag, kind, count) + packed
    return bytes(start) + data + bytes(4)


@pytest.mark.parametrize("space", [2, 65535])
def test_adobe_rgb_by_the_note_of_a_tiff(tmp_path, space):
    """Pillow writes no such directories into a TIFF, cameras do."""
    index = directory(0, (1, 2, 4, b"R03\0"))
    notes = directory(0, (0xA001, 3, 1, space), (0xA005, 4, 1, 400))
    main = directory(0, (256, 4, 1, 8), (257, 4, 1, 8), (258, 3, 1, 8), (259, 3, 1, 1),
                     (262, 3, 1, 2), (273, 4, 1, 500), (277, 3, 1, 3), (278, 4, 1, 8),
                     (279, 4, 1, 192), (0x8769, 4, 1, 300))
    (tmp_path / "a.tif").write_bytes(
        (((b"II*\0" + struct.pack("<I", 8) + main).ljust(300, b"\0") + notes).ljust(400, b"\0")
         + index).ljust(500, b"\0") + bytes(ADOBE) * 64)
    for image in (read_image(tmp_path / "a.tif"), read_photos(tmp_path)[0].image,
                  read_photos(tmp_path, max_side=4)[0].image):
        assert near(image, ADOBE_SHOWN)


@pytest.mark.parametrize(("space", "index", "shown"), [
    (2, "", ADOBE_SHOWN), (65535, "R03", ADOBE_SHOWN), (65535, "R03\0", ADOBE_SHOWN),
    (65535, "", ADOBE), (65535, "R98", ADOBE), (1, "R03", ADOBE), (1, "", ADOBE)])
def test_only_a_clear_note_is_heeded(tmp_path, space, index, shown):
    path = flat(tmp_path / "a.jpg", ADOBE, quality=100, subsampling=0, exif=noted(space, index))
    assert near(read_image(path), shown)


def test_a_profile_goes_before_the_note(tmp_path):
    path = flat(tmp_path / "a.jpg", WIDE, quality=100, subsampling=0, exif=noted(65535),
                icc_profile=profile(P3))
    assert near(read_image(path), WIDE_SHOWN)
    flat(path, ADOBE, quality=100, subsampling=0, exif=noted(65535),
         icc_profile=profile(P3, name="sRGB IEC61966-2.1"))
    assert near(read_image(path), ADOBE)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_turned_picture_keeps_its_note(tmp_path, orientation):
    exif = noted(65535)
    exif[0x0112] = orientation
    path = flat(tmp_path / "a.jpg", ADOBE, 640, quality=100, subsampling=0, exif=exif)
    for image in (read_image(path), read_photos(tmp_path)[0].image,
                  read_photos(tmp_path, max_side=100)[0].image):
        assert near(image, ADOBE_SHOWN)


def test_an_open_picture_is_as_its_file_and_tells_its_file(tmp_path):
    path = flat(tmp_path / "a.jpg", ADOBE, quality=100, subsampling=0, exif=noted(65535))
    from lfportrait.media.colors import srgb
    with open_picture(path) as picture:
        assert near(np.asarray(srgb(picture, file_of(picture))), ADOBE_SHOWN)


@pytest.mark.parametrize(("numbers", "color", "shown", "most"), [
    ((12, 13, 6), WIDE, WIDE_SHOWN, 4), ((1, 13, 6), WIDE, WIDE, 4), ((2, 2, 6), WIDE, WIDE, 4),
    ((9, 14, 6), (202, 59, 19), (253, 3, 3), 4)])
def test_heic_by_its_numbers_alone(tmp_path, numbers, color, shown, most):
    pytest.importorskip("pillow_heif").register_heif_opener()
    path = flat(tmp_path / "a.heic", color, quality=100, chroma=444, color_primaries=numbers[0],
                transfer_characteristics=numbers[1], matrix_coefficients=numbers[2])
    assert near(read_image(path), shown, most)
    assert near(read_photos(tmp_path, max_side=16)[0].image, shown, most)


def test_heic_whose_numbers_say_nothing_may_have_a_note(tmp_path):
    pytest.importorskip("pillow_heif").register_heif_opener()
    path = flat(tmp_path / "a.heic", ADOBE, quality=100, chroma=444, exif=noted(65535).tobytes(),
                color_primaries=2, transfer_characteristics=2, matrix_coefficients=6)
    assert near(read_image(path), ADOBE_SHOWN, 4)


@pytest.mark.parametrize("transfer", [16, 18])
def test_heic_of_high_range_is_bright(tmp_path, transfer):
    """148 of PQ, and 191 of HLG, are a diffuse white."""
    pytest.importorskip("pillow_heif").register_heif_opener()
    gray = 148 if transfer == 16 else 191
    path = flat(tmp_path / "a.heic", (gray,) * 3, quality=100, chroma=444, color_primaries=9,
                transfer_characteristics=transfer, matrix_coefficients=9)
    image = read_image(path)
    assert image[16, 16].min() > 225 and np.ptp(image[16, 16].astype(int)) <= 3


def with_numbers(path, primaries, transfer, matrix=6):
    """The numbers in an AVIF's `colr` box replaced, or such a box put into its properties."""
    data = bytearray(path.read_bytes())
    numbers = struct.pack(">HHHB", primaries, transfer, matrix, 0x80)
    at = data.find(b"colrnclx")
    assert at > 0, "Pillow's AVIF has such a box"
    data[at + 8:at + 15] = numbers
    path.write_bytes(bytes(data))
    return path


def test_avif_by_its_numbers_alone(tmp_path):
    path = flat(tmp_path / "a.avif", WIDE, quality=100, subsampling="4:4:4")
    assert near(read_image(path), WIDE)
    with_numbers(path, 12, 13)
    assert near(read_image(path), WIDE_SHOWN)
    assert near(read_photos(tmp_path, max_side=16)[0].image, WIDE_SHOWN)
    flat(path, (148,) * 3, quality=100, subsampling="4:4:4")
    with_numbers(path, 9, 16)
    assert read_image(path)[16, 16].min() > 225


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(path, values, *chunks, bits=8):
    """An RGB PNG with chunks behind its header."""
    height, width = values.shape[:2]
    rows = values.astype(">u2" if bits == 16 else np.uint8)
    data = b"".join(b"\0" + row.tobytes() for row in rows)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 2, 0, 0,
                                                         0))
        + b"".join(chunks) + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b""))
    return path


def chrm(*values):
    return chunk(b"cHRM", struct.pack(">8I", *(round(value * 100_000) for value in values)))


P3_POINTS = (0.3127, 0.3290, 0.680, 0.320, 0.265, 0.690, 0.150, 0.060)
GAMMA = chunk(b"gAMA", struct.pack(">I", 45455))


@pytest.mark.parametrize("bits", [8, 16])
def test_png_by_its_chunks(tmp_path, bits):
    scale = 257 if bits == 16 else 1
    color = np.full((8, 8, 3), WIDE) * scale
    path = tmp_path / "a.png"
    cicp = chunk(b"cICP", bytes([12, 13, 0, 1]))
    assert near(read_image(png(path, color, bits=bits)), WIDE, 1)
    assert near(read_image(png(path, color, cicp, bits=bits)), WIDE_SHOWN)
    assert near(read_image(png(path, color, GAMMA, chrm(*P3_POINTS), bits=bits)), WIDE_SHOWN, 3)
    # What says sRGB is sRGB; cICP goes before it.
    plain = chunk(b"sRGB", b"\0")
    assert near(read_image(png(path, color, plain, GAMMA, chrm(*P3_POINTS), bits=bits)), WIDE, 1)
    assert near(read_image(png(path, color, cicp, plain, bits=bits)), WIDE_SHOWN)
    # Light itself: half of it is 188.
    linear = chunk(b"gAMA", struct.pack(">I", 100_000))
    assert near(read_image(png(path, np.full((8, 8, 3), 127.5 * scale), linear, bits=bits)), 188)
    pq = chunk(b"cICP", bytes([9, 16, 0, 1]))
    assert read_image(png(path, np.full((8, 8, 3), 148 * scale), pq, bits=bits)).min() > 225


@pytest.mark.parametrize("points", [(0,) * 8, (0.3127, 0.329, *(0.3, 0.3) * 3), (5.0,) * 8])
def test_png_points_that_make_no_sense_change_nothing(tmp_path, points):
    path = png(tmp_path / "a.png", np.full((8, 8, 3), WIDE), GAMMA, chrm(*points))
    assert near(read_image(path), WIDE, 1)


def test_palettes_with_transparency_and_print_colors(tmp_path):
    picture = Image.new("P", (8, 8), 1)
    picture.putpalette([0, 0, 0, *WIDE])
    picture.paste(0, (0, 0, 4, 8))
    picture.save(tmp_path / "a.png", transparency=0)
    found = read_image(tmp_path / "a.png")
    assert found.shape == (8, 8, 4)
    assert (found[:, :4, 3] == 0).all() and (found[:, 4:] == (*WIDE, 255)).all()
    Image.new("CMYK", (8, 8), (0, 200, 200, 0)).save(tmp_path / "b.jpg", quality=100)
    red = read_image(tmp_path / "b.jpg")[4, 4].astype(int)
    assert red[0] > 180 and red[1:].max() < 100
    gray = Image.new("L", (8, 8), 100)
    gray.putalpha(Image.new("L", (8, 8), 50))
    gray.save(tmp_path / "c.png")
    assert (read_image(tmp_path / "c.png") == (100, 100, 100, 50)).all()


def test_colors_between_known_spaces():
    """All grays are kept, by BT.709's curve to the very value; BT.2020's skin is nearly red."""
    gray = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    for primaries, transfer in ((9, 14), (9, 1), (12, 13), (1, 1), (9, 15)):
        found = from_space(gray, coded_space(primaries, transfer))
        assert np.abs(found.astype(int) - gray).max() <= 1, (primaries, transfer)
    red = from_space(np.full((1, 1, 3), (202, 59, 19), np.uint8), coded_space(9, 14))
    assert red[0, 0, 0] > 250 and red[0, 0, 1:].max() < 20
    assert coded_space(255, 255).is_srgb and coded_space(1, 13).is_srgb


def hair(side=400, dark=30):
    """A straight cut-out with soft edges: colors float64 [S, S, 3], alpha [S, S]."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:side, :side] - side / 2
    alpha = np.clip((side * 0.4 - np.hypot(x, y)) * 6 + rng.normal(0, 20, (side, side)), 0, 255)
    colors = np.clip(rng.normal(dark, 8, (side, side, 3)), 0, 255)
    return colors, alpha


@pytest.mark.parametrize("dark", [12, 30, 60, 200])
def test_premultiplied_cut_outs_become_straight(tmp_path, dark):
    colors, alpha = hair(dark=dark)
    wrong = np.dstack([colors * alpha[..., None] / 255, alpha]).astype(np.uint8)
    Image.fromarray(wrong).save(tmp_path / "a.png")
    with pytest.warns(UserWarning, match="multiplied by its alpha") as told:
        found = read_image(tmp_path / "a.png")
    assert len(told) == 1
    solid = alpha > 128
    assert np.abs(found[solid][:, :3].astype(float) - colors[solid]).max() <= 4


@pytest.mark.parametrize("dark", [0, 5, 12, 20, 30, 60, 200])
def test_straight_cut_outs_are_left_as_they_are(tmp_path, dark):
    colors, alpha = hair(dark=dark)
    image = np.dstack([colors, alpha]).astype(np.uint8)
    image[alpha == 0, :3] = 0  # hidden colors are black, as many programs write them
    Image.fromarray(image).save(tmp_path / "a.png")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.array_equal(read_image(tmp_path / "a.png"), image)


def test_a_few_half_transparent_pixels_say_nothing():
    picture = np.zeros((20, 20, 4), np.uint8)
    picture[:2, :, 3] = 128
    assert not looks_premultiplied(picture)
    assert np.array_equal(straight(np.full((1, 1, 4), (50, 60, 70, 128), np.uint8)),
                          [[[100, 120, 139, 128]]])


def test_the_check_of_a_large_cut_out_is_quick():
    colors, alpha = hair(side=1000)
    image = np.tile(np.dstack([colors, alpha]).astype(np.uint8), (6, 4, 1))
    began = time.perf_counter()
    assert not looks_premultiplied(image)
    assert time.perf_counter() - began < 2.0


def test_hidden_colors_do_not_get_into_edges():
    """A straightened cut-out composites the same, whatever its hidden colors are."""
    rng = np.random.default_rng(3)
    smooth = np.asarray(Image.fromarray(rng.integers(60, 220, (6, 8, 3), np.uint8)).resize(
        (160, 120), Image.Resampling.BICUBIC))
    y, x = np.mgrid[:120, :160]
    alpha = np.clip((45 - np.hypot(x - 80, y - 60)) * 128, 0, 255).astype(np.uint8)
    kept = np.dstack([smooth, alpha])
    black = kept.copy()
    black[alpha == 0, :3] = 0
    lens = Lens(160, 120, (150, 150), (80, 60), "opencv", (-0.15,))
    shown = []
    for image in (kept, black):
        flat_image, _ = undistort(image, lens)
        part = flat_image[..., 3:] / 255.0
        shown.append(flat_image[..., :3] * part + 255 * (1 - part))
    assert np.abs(shown[0] - shown[1]).max() <= 2
    whole, _ = undistort(np.dstack([smooth, np.full((120, 160), 255, np.uint8)]), lens)
    inner = flat_image[..., 3] == 255
    assert np.abs(flat_image[inner][:, :3].astype(int) - whole[inner][:, :3]).max() <= 2
