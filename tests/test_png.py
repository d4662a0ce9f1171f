"""PNG files of large pictures: what Pillow and OpenCV read back, and how large they are."""

import io
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from lfportrait import png
from lfportrait.png import PngWriter, write_png


def _file(image):
    stream = io.BytesIO()
    write_png(stream, image)
    return stream.getvalue()


def _read(data, channels):
    found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return found if channels == 1 else found[..., [2, 1, 0, 3][:channels]]


def _painted(height, width, channels=3, seed=0):
    """Slopes with a little noise, as pictures have, and a part that is black."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    image = 90 + 60 * np.sin(x / 40)[..., None] + y[..., None] / 9 + np.arange(channels) * 10
    image = np.clip(image + rng.normal(0, 3, image.shape), 0, 255).astype(np.uint8)
    image[height // 2:, :width // 2] = 0
    return image


@given(st.integers(1, 40), st.integers(1, 60), st.sampled_from([1, 3, 4]),
       st.sampled_from([np.uint8, np.uint16]), st.integers(0, 9))
@settings(max_examples=30, deadline=None)
def test_every_value_is_read_back(height, width, channels, kind, seed):
    rng = np.random.default_rng(seed)
    shape = (height, width) if channels == 1 else (height, width, channels)
    image = rng.integers(0, np.iinfo(kind).max + 1, shape).astype(kind)
    assert (_read(_file(image), channels) == image).all()


def test_a_picture_of_many_pieces_and_of_rows_by_rows():
    image = _painted(700, 900)  # more than a megabyte
    assert image.nbytes > png._PIECE
    stream = io.BytesIO()
    writer = PngWriter(stream, 900, 700, chunks=[(b"tEXt", b"Title\0slopes")])
    for first in range(0, 700, 33):
        writer.write(image[first:first + 33])
    writer.end()
    with Image.open(stream) as found:
        found.load()
        assert found.text == {"Title": "slopes"}
        assert (np.asarray(found) == image).all()
    whole = _file(image)
    assert (np.asarray(Image.open(io.BytesIO(whole))) == image).all()
    # Every chunk's sum and the stream's own, which some readers skip.
    place, pixels = 8, b""
    while place < len(whole):
        length = int.from_bytes(whole[place:place + 4], "big")
        kind, data = whole[place + 4:place + 8], whole[place + 8:place + 8 + length]
        assert zlib.crc32(kind + data) == int.from_bytes(
            whole[place + 8 + length:place + 12 + length], "big")
        pixels += data if kind == b"IDAT" else b""
        place += 12 + length
    assert len(zlib.decompress(pixels)) == 700 * (3 * 900 + 1)


@pytest.mark.parametrize("image", [
    _painted(600, 800), np.zeros((600, 800, 3), np.uint8),
    np.random.default_rng(1).integers(0, 256, (600, 800, 3)).astype(np.uint8),
    np.repeat(_painted(600, 1), 800, axis=1), np.repeat(_painted(2, 800), 300, axis=0)],
    ids=["painted", "black", "noise", "columns alike", "rows alike"])
def test_files_are_about_as_large_as_pillows(image):
    usual = io.BytesIO()
    Image.fromarray(image).save(usual, "PNG", compress_level=4)
    # Where rows repeat, strings that come again are few bytes either way.
    assert len(_file(image)) < max(1.15 * len(usual.getvalue()), 0.01 * image.nbytes)


def test_the_same_bytes_on_any_number_of_cores(monkeypatch):
    image = _painted(700, 900)
    first = _file(image)
    png._threads.cache_clear()
    monkeypatch.setattr(png, "usable_cores", lambda: 1)
    assert _file(image) == first
    png._threads.cache_clear()


def test_rows_of_another_width_are_refused():
    writer = PngWriter(io.BytesIO(), 5, 2)
    with pytest.raises(ValueError, match="do not fit"):
        writer.write(np.zeros((1, 6, 3), np.uint8))
