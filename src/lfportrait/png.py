"""PNG files of large pictures, written from the top down by all cores.

Pillow tries all five of PNG's filters on every row, then looks for strings that come again, on one
core. Pictures for panels and printers are hard to compress and hold few such strings: here each row
is the difference to the row above, to the pixel before or to the mean of both, whichever is
smallest, and is coded by Huffman's code alone, or with runs where most of it is zero. Pieces of the
picture are coded side by side, by zlib-ng. A 4K picture takes a fifth of the time on one core, for
a file as large.
"""

import functools
import os
import struct
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import BinaryIO

import numpy as np
from zlib_ng import zlib_ng as zlib

from .arrays import UInt8, UInt32, Unsigned
from .measure import usable_cores

_PIECE = 1 << 20
"""Bytes of a picture that are coded together, about: as many on any machine, for the same file."""
_BLOCK = 1 << 17
"""Bytes that are filtered at once: with what is tried on them they fit into a core's cache."""
_SUB, _UP, _AVERAGE = 1, 2, 3  # PNG's numbers of the filters.
_KINDS = {1: 0, 2: 4, 3: 2, 4: 6}  # PNG's kinds of color by the number of channels.


class PngWriter:
    """A PNG file that takes rows from the top down.

    Its channels are 1 grey, 2 grey and alpha, 3 color, 4 color and alpha, of 8 or 16 bits;
    ``chunks``, kinds and contents, come before the pixels.
    """

    def __init__(self, stream: BinaryIO, width: int, height: int, *, channels: int = 3,
                 bits: int = 8, chunks: Iterable[tuple[bytes, bytes]] = ()) -> None:
        self._stream = stream
        self._pixel = channels * bits // 8
        self._above = np.zeros(width * self._pixel, np.uint8)
        self._check = 1
        stream.write(b"\x89PNG\r\n\x1a\n")
        self._chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, _KINDS[channels],
                                         0, 0, 0))
        for kind, data in chunks:
            self._chunk(kind, data)
        # A stream of blocks that are deflated apart from each other.
        self._chunk(b"IDAT", b"\x78\x01")

    def write(self, rows: Unsigned) -> None:
        """Append rows: [n, W] or [n, W, channels], uint8 or uint16 as the bits are."""
        lines = rows.astype(rows.dtype.newbyteorder(">"), copy=False)
        lines = np.ascontiguousarray(lines).view(np.uint8).reshape(len(rows), -1)
        if lines.shape[1] != len(self._above):
            raise ValueError("these rows do not fit into the picture")
        many = max(1, _PIECE // lines.shape[1])
        starts = range(0, len(lines), many)
        above = [self._above, *(lines[start - 1] for start in starts[1:])]
        pieces = [lines[start:start + many] for start in starts]
        for check, data in _threads().map(functools.partial(_coded, self._pixel), pieces, above):
            self._check = _joined(self._check, *check)
            self._chunk(b"IDAT", data)
        if len(lines):
            self._above = lines[-1].copy()

    def end(self) -> None:
        """Complete the file."""
        self._chunk(b"IDAT", b"\x03\x00" + struct.pack(">I", self._check))
        self._chunk(b"IEND", b"")

    def _chunk(self, kind: bytes, data: bytes) -> None:
        self._stream.write(struct.pack(">I", len(data)) + kind)
        self._stream.write(data)
        self._stream.write(struct.pack(">I", zlib.crc32(data, zlib.crc32(kind))))


def write_png(stream: BinaryIO, image: Unsigned,
              chunks: Iterable[tuple[bytes, bytes]] = ()) -> None:
    """Write a picture [H, W] or [H, W, 1 to 4], uint8 or uint16; ``chunks`` as `PngWriter`'s."""
    height, width, channels = (*image.shape, 1)[:3]
    writer = PngWriter(stream, width, height, channels=channels, bits=8 * image.dtype.itemsize,
                       chunks=chunks)
    writer.write(image)
    writer.end()


@functools.cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(usable_cores(), "png")


if hasattr(os, "register_at_fork"):
    # A forked process has none of its parent's threads.
    os.register_at_fork(after_in_child=_threads.cache_clear)


def _coded(pixel: int, lines: UInt8, above: UInt8) -> tuple[tuple[int, int], bytes]:
    """A piece of the deflated stream that ends at a whole byte, and its sum and length."""
    filtered = _filtered(lines, above, pixel)
    # Of what is mostly zero, runs are worth looking for.
    few = 2 * np.count_nonzero(filtered) < filtered.size
    packer = zlib.compressobj(6, zlib.DEFLATED, -15, 9, zlib.Z_RLE if few else zlib.Z_HUFFMAN_ONLY)
    data = packer.compress(filtered.data) + packer.flush(zlib.Z_SYNC_FLUSH)
    return (zlib.adler32(filtered.data), filtered.size), data


def _filtered(lines: UInt8, above: UInt8, pixel: int) -> UInt8:
    """Rows [n, W] as differences, with the number of each one's filter before it: [n, W + 1]."""
    out = np.empty((len(lines), lines.shape[1] + 1), np.uint8)
    many = max(1, _BLOCK // lines.shape[1])
    for start in range(0, len(lines), many):
        rows, part = lines[start:start + many], out[start:start + many]
        upper, before = np.empty_like(rows), np.zeros_like(rows)
        upper[0] = lines[start - 1] if start else above
        upper[1:] = rows[:-1]
        before[:, pixel:] = rows[:, :-pixel]
        mean = (upper & before) + ((upper ^ before) >> 1)
        found: UInt8 = rows - upper
        part[:, 0], least = _UP, _amount(found)
        for kind, guess in ((_SUB, before), (_AVERAGE, mean)):
            other = rows - guess
            amount = _amount(other)
            better = amount < least
            part[better, 0], least = kind, np.minimum(amount, least)
            found[better] = other[better]
        part[:, 1:] = found
    return out


def _amount(differences: UInt8) -> UInt32:
    """Sum of each row's differences, 255 being -1."""
    return np.asarray(np.minimum(differences, -differences).sum(axis=1, dtype=np.uint32))


def _joined(first: int, second: int, length: int) -> int:
    """Adler's sum of two pieces from the sum of each, and the length of the second."""
    most = 65521
    low = (first & 0xFFFF) + (second & 0xFFFF) - 1
    high = (first >> 16) + (second >> 16) + (length % most) * ((first & 0xFFFF) - 1)
    return (high % most) << 16 | low % most
