"""Depth of phones' portrait pictures: what it means, which way up it lies, and damaged files."""

import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lfportrait.media.depth import DepthMap, read_depth
from lfportrait.media.pictures import read_image

from .depth_files import (
    MATTE,
    apple_notes,
    container,
    dynamic_depth,
    encoded,
    gdepth,
    heic,
    jpeg,
    multi_picture,
    noted,
    representation,
)

# Black (near) at the upper left, white at the lower right; no two corners alike.
RAMP = (np.linspace(0, 155, 32)[None, :] + np.linspace(0, 100, 24)[:, None]).astype(np.uint8)
SHARES = RAMP / 255.0
RANGE = {"Format": "RangeInverse", "Near": "0.5", "Far": "4", "Units": "m"}
INVERSE = 1 / (2.0 + SHARES * (0.25 - 2.0))
PICTURE = np.random.default_rng(0).integers(0, 255, (96, 128, 3)).astype(np.uint8)
WIDE = np.tile(np.linspace(0, 255, 64).astype(np.uint8), (48, 1))


@pytest.fixture
def read(tmp_path: Path):
    """The depth of a file with these bytes, without a warning."""
    def reader(data: bytes, name: str = "photo.jpg") -> DepthMap | None:
        path = tmp_path / name
        path.write_bytes(data)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return read_depth(path)
    return reader


def test_gdepth_inverse(read):
    found = read(gdepth(jpeg(), encoded(RAMP), RANGE))
    distance, metric = found.distance()
    assert metric and found.source == "gdepth" and (found.near, found.far) == (0.5, 4.0)
    assert found.along == "axis" and found.confidence is None
    np.testing.assert_allclose(distance, INVERSE, rtol=1e-5)
    assert found.ratio((64, 48)) == (2.0, 2.0)


def test_gdepth_linear_along_rays_in_millimetres(read):
    """16 bits, with a confidence at half the size."""
    deep = (SHARES * 65535).astype(np.uint16)
    sure = np.repeat(np.array([[0, 255]], np.uint8), 8, axis=1).repeat(12, axis=0)
    notes = {"Format": "RangeLinear", "Near": "500", "Far": "4000", "Units": "mm",
             "MeasureType": "OpticRay"}
    found = read(gdepth(jpeg(), encoded(deep), notes, encoded(sure)))
    distance, metric = found.distance()
    assert metric and found.along == "ray" and found.kind == "distance"
    np.testing.assert_allclose(distance, 0.5 + SHARES * 3.5, atol=1e-4)
    assert found.confidence.shape == distance.shape
    assert (found.confidence[:, :16] == 0).all() and (found.confidence[:, 16:] == 1).all()


def test_gdepth_in_extended_xmp(read):
    """Data of several segments, which are put together in their order."""
    noise = np.random.default_rng(1).integers(0, 255, (300, 400)).astype(np.uint8)
    data = gdepth(jpeg(), encoded(noise), RANGE, encoded(noise), apart=True)
    assert data.count(b"http://ns.adobe.com/xmp/extension/") > 3
    found = read(data)
    np.testing.assert_allclose(1 / found.distance()[0], 2.0 - noise / 255.0 * 1.75, rtol=1e-5)
    np.testing.assert_allclose(found.confidence, noise / 255.0, atol=1e-6)


def test_unnoted_units_are_no_metres(read):
    notes = {name: value for name, value in RANGE.items() if name != "Units"}
    distance, metric = read(gdepth(jpeg(), encoded(RAMP), notes)).distance()
    assert not metric
    np.testing.assert_allclose(distance, INVERSE, rtol=1e-5)


def test_no_range_keeps_the_order(read):
    found = read(gdepth(jpeg(), encoded(RAMP), {"Format": "RangeInverse"}))
    distance, metric = found.distance()
    assert not metric and found.near is None and found.far is None
    assert distance[0, 0] < distance[12, 16] < distance[-2, -2]


def test_endless_far(read):
    found = read(gdepth(jpeg(), encoded(np.array([[0, 255]], np.uint8)), RANGE | {"Far": "inf"}))
    distance, _ = found.distance()
    assert distance[0, 0] == pytest.approx(0.5) and np.isnan(distance[0, 1])
    assert found.far is None


@pytest.mark.parametrize("orientation", range(1, 9))
def test_upright_as_its_picture(tmp_path, orientation):
    """The depth's brightest corner is where the picture's is."""
    upright = np.zeros((48, 64), np.uint8)
    upright[:12, :16] = 255
    exif = Image.Exif()
    exif[0x0112] = orientation
    picture = encoded(np.dstack([upright] * 3), "JPEG", exif=exif.tobytes(), quality=95)
    path = tmp_path / "photo.jpg"
    path.write_bytes(gdepth(picture, encoded(upright[::2, ::2]), RANGE))
    shown = read_image(path)[..., 0] > 128
    found = read_depth(path)
    assert found.values.shape == (shown.shape[0] // 2, shown.shape[1] // 2)
    np.testing.assert_array_equal(found.distance()[0] > 1.0, shown[::2, ::2])


def test_a_map_that_was_turned_already(read):
    found = read(gdepth(jpeg(64, 48, 6), encoded(RAMP.T.copy()), RANGE))
    np.testing.assert_allclose(found.distance()[0], INVERSE.T, rtol=1e-5)


DYNAMIC = {"Format": "RangeInverse", "Near": "0.5", "Far": "4", "Units": "Meters",
           "ItemSemantic": "Depth", "DepthURI": "android/depth", "ConfidenceURI": "android/sure"}


@pytest.mark.parametrize("padding, between", [(0, b""), (7, b""), (0, b"vendor's own" * 9)])
@pytest.mark.parametrize("progressive", [False, True])
def test_dynamic_depth(read, padding, between, progressive):
    files = {"android/other": encoded(255 - RAMP), "android/depth": encoded(RAMP),
             "android/sure": encoded(RAMP.max() - RAMP)}
    found = read(dynamic_depth(jpeg(progressive=progressive), files, DYNAMIC, padding, between))
    distance, metric = found.distance()
    assert metric and found.source == "dynamic depth"
    np.testing.assert_allclose(distance, INVERSE, rtol=1e-5)
    np.testing.assert_allclose(found.confidence, (RAMP.max() - RAMP) / 255.0, atol=1e-6)


def test_dynamic_depth_in_diopters(read):
    notes = DYNAMIC | {"Format": "RangeLinear", "Near": "2", "Far": "0.25", "Units": "Diopters"}
    found = read(dynamic_depth(jpeg(), {"android/depth": encoded(RAMP)}, notes))
    distance, metric = found.distance()
    assert metric and (found.near, found.far) == (0.5, 4.0)
    np.testing.assert_allclose(distance, INVERSE, rtol=1e-5)


def test_a_segmentation_is_no_depth(read):
    notes = DYNAMIC | {"ItemSemantic": "Segmentation"}
    assert read(dynamic_depth(jpeg(), {"android/depth": encoded(RAMP)}, notes)) is None


def test_the_later_container(read):
    files = [("GainMap", jpeg(16, 16)), ("Depth", encoded(RAMP)), ("Confidence", encoded(RAMP))]
    found = read(container(jpeg(), files, 'GDepth:Format="RangeInverse" GDepth:Near="0.5" '
                                          'GDepth:Far="4" GDepth:Units="m"'))
    np.testing.assert_allclose(found.distance()[0], INVERSE, rtol=1e-5)
    np.testing.assert_allclose(found.confidence, SHARES, atol=1e-6)
    assert not read(container(jpeg(), files)).metric
    assert read(container(jpeg(), files[:1])) is None


@pytest.mark.parametrize("order", "<>")
def test_the_jpeg_of_an_iphone(read, order):
    """The matte before it is none."""
    grey = encoded(RAMP, "JPEG", quality=100)
    pictures = [noted(encoded(255 - RAMP, "JPEG"), MATTE),
                noted(grey, apple_notes(0.25, 2.0, "absolute"))]
    found = read(multi_picture(jpeg(), pictures, order))
    distance, metric = found.distance()
    assert metric and found.source == "apple jpeg" and (found.near, found.far) == (0.5, 4.0)
    np.testing.assert_allclose(1 / distance, 0.25 + SHARES * 1.75, atol=0.03)
    assert read(multi_picture(jpeg(), pictures[:1], order)) is None


@pytest.mark.parametrize("notes, kind, expected, near_far", [
    (representation(1, d_min=0.5, d_max=2.0), "inverse", (2.0, 0.5), (0.5, 2.0)),
    (representation(0, z_near=0.5, z_far=4.0), "inverse", (4.0, 0.5), (0.5, 4.0)),
    (representation(2, z_near=0.5, z_far=4.0), "distance", (0.5, 4.0), (0.5, 4.0)),
], ids=["disparity", "inverse z", "z"])
def test_heic_by_the_standard(read, notes, kind, expected, near_far):
    pytest.importorskip("pillow_heif")
    found = read(heic(PICTURE, WIDE, notes), "photo.heic")
    distance, metric = found.distance()
    assert not metric and found.kind == kind and found.source == "heic"
    assert (found.near, found.far) == pytest.approx(near_far)
    assert distance.shape == (48, 64)
    np.testing.assert_allclose(distance[:, [0, -1]], np.tile(expected, (48, 1)), rtol=0.05)


@pytest.mark.parametrize("accuracy, metric", [("absolute", True), ("relative", False)])
def test_heic_of_an_iphone(read, accuracy, metric):
    """Its own notes say more than the standard's; the name is a JPEG's, the content counts."""
    pytest.importorskip("pillow_heif")
    data = heic(PICTURE, WIDE, representation(1, d_min=1.0, d_max=9.0), 3,
                packet=MATTE + apple_notes(0.25, 2.0, accuracy))
    found = read(data, "photo.jpg")
    distance, in_metres = found.distance()
    assert in_metres is metric and found.values.shape == (64, 48)
    # A quarter turn clockwise: the left edge, which is dark and far, comes up.
    np.testing.assert_allclose(distance[0], 4.0, rtol=0.1)
    np.testing.assert_allclose(distance[-1], 0.5, rtol=0.1)


def test_heic_whose_depth_lies_another_way(tmp_path):
    pytest.importorskip("pillow_heif")
    path = tmp_path / "photo.heic"
    path.write_bytes(heic(PICTURE, WIDE, turns=1, depth_turns=0))
    with pytest.warns(UserWarning, match=r"photo\.heic.*another way"):
        assert read_depth(path) is None


def test_no_depth(read, tmp_path):
    pytest.importorskip("pillow_heif").register_heif_opener()
    assert read(jpeg()) is None
    assert read(multi_picture(jpeg(), [jpeg(16, 16)])) is None
    assert read(encoded(RAMP), "photo.png") is None
    assert read(encoded(PICTURE, "HEIF"), "photo.heic") is None
    assert read(b"", "empty.jpg") is None
    assert read_depth(tmp_path / "missing.jpg") is None


def test_a_jpeg_without_depth_is_not_read(tmp_path):
    """24 megapixels would take a quarter of a second to decode."""
    path = tmp_path / "photo.jpg"
    path.write_bytes(encoded(np.zeros((4000, 6000, 3), np.uint8), "JPEG"))
    read_depth(path)
    start = time.perf_counter()
    for _ in range(10):
        read_depth(path)
    assert (time.perf_counter() - start) / 10 < 0.02


def test_damaged_depth_is_left_out(tmp_path):
    path = tmp_path / "photo.jpg"
    for data in (gdepth(jpeg(), b"no picture", RANGE),
                 gdepth(jpeg(), encoded(RAMP), RANGE | {"Format": "Other"}),
                 dynamic_depth(jpeg(), {"android/depth": encoded(RAMP)}, DYNAMIC)[:-10],
                 gdepth(jpeg(), encoded(RAMP), RANGE, apart=True).replace(
                     b"http://ns.adobe.com/xmp/extension/", b"http://ns.adobe.com/xmp/extinction"),
                 noted(jpeg(), b'<!DOCTYPE a [<!ENTITY b "c">]><x>http://ns.google.com/photos/1.0/'
                               b"depthmap/</x>")):
        path.write_bytes(data)
        with pytest.warns(UserWarning, match=r"photo\.jpg.*left out"):
            assert read_depth(path) is None
        assert read_image(path).shape == (48, 64, 3)


def _every_kind() -> list[bytes]:
    return [gdepth(jpeg(), encoded(RAMP), RANGE, encoded(RAMP)),
            gdepth(jpeg(), encoded(RAMP), RANGE, apart=True),
            dynamic_depth(jpeg(), {"android/depth": encoded(RAMP),
                                   "android/sure": encoded(RAMP)}, DYNAMIC),
            multi_picture(jpeg(), [noted(encoded(RAMP, "JPEG"), apple_notes(0.25, 2.0))]),
            heic(PICTURE[:32, :32], WIDE, representation(1, d_min=0.5, d_max=2.0), 1,
                 packet=apple_notes(0.25, 2.0))]


@pytest.mark.parametrize("kind", range(5))
def test_damage_never_stops_a_picture(tmp_path, kind):
    """Files that are cut off, and files with wrong bytes."""
    pytest.importorskip("pillow_heif")
    data = _every_kind()[kind]
    path = tmp_path / "photo.jpg"
    rng = np.random.default_rng(kind)
    damaged = [data[:end] for end in rng.integers(0, len(data), 40)]
    for _ in range(60):
        one = bytearray(data)
        for place in rng.integers(0, len(data) if kind < 4 else 1200, 4):
            one[place] = rng.integers(0, 256)
        damaged.append(bytes(one))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for one in damaged:
            path.write_bytes(one)
            found = read_depth(path)
            assert found is None or found.values.dtype == np.float32
