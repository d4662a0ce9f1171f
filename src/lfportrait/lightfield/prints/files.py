"""TIFF and PNG files for printers, written row by row.

Pages are larger than memory should be, so nothing here holds one. Both formats carry the resolution
and an sRGB profile. TIFF: one strip a band, uncompressed, which every print program reads at once.
PNG: by all cores (`lfportrait.png`).
"""

from __future__ import annotations

import contextlib
import functools
import struct
import zlib
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...files import atomic_write
from ...measure import free_disk_bytes
from ...png import PngWriter
from .sheet import INCH

_TIFF, _PNG = (".tif", ".tiff"), (".png",)
_HEAD = 1 << 16
"""Bytes that a TIFF's entries may take."""
_TIFF_MOST = (1 << 32) - 1
"""A TIFF's places are 32-bit numbers."""
_LEAST_SHARE = 0.02
"""Of a PNG's pixels' bytes, what its file takes at least."""


@functools.cache
def srgb_profile() -> bytes:
    """An ICC profile of sRGB."""
    from PIL import ImageCms

    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


class RowFile:
    """A picture's file that takes rows from the top down.

    Parameters
    ----------
    stream : Where to write; a place in it can be sought.
    width, height : Size in pixels.
    dpi : Pixels per inch.
    grey : True: one channel of 16 bits, a measure and no color; False: sRGB, 3 channels of 8 bits.
    note : A line about the picture.
    """

    def __init__(self, stream: BinaryIO, width: int, height: int, dpi: float, *,
                 grey: bool = False, note: str = "") -> None:
        self.stream, self.width, self.height, self.dpi = stream, width, height, dpi
        self.grey, self.note = grey, note
        self.rows = 0
        self._begin()

    def write(self, rows: NDArray[np.unsignedinteger]) -> None:
        """Append rows: uint8 [n, W, 3], or uint16 [n, W]."""
        if self.rows + len(rows) > self.height or rows.shape[1] != self.width:
            raise ValueError("these rows do not fit into the picture")
        self._append(np.ascontiguousarray(rows))
        self.rows += len(rows)

    def end(self) -> None:
        """Complete the file."""
        if self.rows != self.height:
            raise ValueError(f"{self.height - self.rows} rows are missing")
        self._finish()

    def _begin(self) -> None:
        raise NotImplementedError

    def _append(self, rows: NDArray[np.unsignedinteger]) -> None:
        raise NotImplementedError

    def _finish(self) -> None:
        raise NotImplementedError


class TiffRows(RowFile):
    """A baseline TIFF, little-endian, each call of `write` a strip of as many rows as the first."""

    def _begin(self) -> None:
        self._strips: list[tuple[int, int]] = []
        self._strip_rows = 0
        self.stream.write(b"II*\0\0\0\0\0")

    def _append(self, rows: NDArray[np.unsignedinteger]) -> None:
        self._strip_rows = self._strip_rows or len(rows)
        if self.rows % self._strip_rows:
            raise ValueError("only the last strip may have fewer rows")
        self._strips.append((self.stream.tell(), rows.nbytes))
        self.stream.write(rows.astype(rows.dtype.newbyteorder("<"), copy=False).data)

    def _finish(self) -> None:
        self._pad()
        text = self.note.encode("ascii", "replace") + b"\0"
        # Numbers in the order of their tags: (kind, values); kinds 2 text, 3 and 4 whole numbers
        # of 16 and 32 bits, 5 fractions, 7 bytes.
        resolution = Fraction(self.dpi).limit_denominator(10_000)
        fraction = [resolution.numerator, resolution.denominator]
        offsets, counts = zip(*self._strips, strict=True)
        entries: dict[int, tuple[int, object]] = {
            256: (4, [self.width]), 257: (4, [self.height]),
            258: (3, [16] if self.grey else [8, 8, 8]), 259: (3, [1]),
            262: (3, [1 if self.grey else 2]), 270: (2, text), 273: (4, offsets), 274: (3, [1]),
            277: (3, [1 if self.grey else 3]), 278: (4, [self._strip_rows]), 279: (4, counts),
            282: (5, fraction), 283: (5, fraction), 284: (3, [1]), 296: (3, [2]),
            305: (2, b"lfportrait\0")}
        if not self.grey:
            entries[34675] = (7, srgb_profile())
        # What is longer than four bytes lies before the table.
        table = struct.pack("<H", len(entries))
        for tag, (kind, values) in sorted(entries.items()):
            data = (bytes(values) if isinstance(values, bytes) else
                    np.asarray(values, "<u2" if kind == 3 else "<u4").tobytes())
            count = len(data) // {2: 1, 3: 2, 4: 4, 5: 8, 7: 1}[kind]
            if len(data) > 4:
                place = self._pad()
                self.stream.write(data)
                data = struct.pack("<I", place)
            table += struct.pack("<HHI", tag, kind, count) + data.ljust(4, b"\0")
        place = self._pad()
        self.stream.write(table + bytes(4))
        self.stream.seek(4)
        self.stream.write(struct.pack("<I", place))

    def _pad(self) -> int:
        """Go on at an even place; it is returned."""
        place = self.stream.tell()
        self.stream.write(bytes(place % 2))
        if place + 1 > _TIFF_MOST:
            raise UserError("a TIFF can't hold more than 4 GiB: write it as .png")
        return place + place % 2


class PngRows(RowFile):
    """A PNG, compressed by all cores."""

    def _begin(self) -> None:
        meter = round(self.dpi / INCH * 1000)
        chunks = [(b"pHYs", struct.pack(">IIB", meter, meter, 1))]
        if not self.grey:
            chunks.insert(0, (b"iCCP", b"sRGB\0\0" + zlib.compress(srgb_profile(), 9)))
        if self.note:
            chunks.append((b"tEXt", b"Description\0" + self.note.encode("latin-1", "replace")))
        self._png = PngWriter(self.stream, self.width, self.height, channels=1 if self.grey else 3,
                              bits=16 if self.grey else 8, chunks=chunks)

    def _append(self, rows: NDArray[np.unsignedinteger]) -> None:
        self._png.write(rows)

    def _finish(self) -> None:
        self._png.end()


def check_file(path: Path, width: int, height: int, *, grey: bool = False) -> None:
    """Refuse a file that can't hold a page, before anything is computed.

    Raises
    ------
    UserError
        If the format loses pixels, can't hold so many, or the disk is too full.
    """
    suffix = path.suffix.lower()
    if suffix not in _TIFF + _PNG:
        raise UserError(f"a print must keep every pixel: write {path.name or path} as .tiff or "
                        ".png")
    size = width * height * (2 if grey else 3)
    if suffix in _TIFF and size + _HEAD > _TIFF_MOST:
        raise UserError(f"a TIFF can't hold more than 4 GiB, and {width} x {height} pixels take "
                        f"{size / 2 ** 30:.1f}: write it as .png, or with a lower --dpi")
    least = size if suffix in _TIFF else round(_LEAST_SHARE * size)
    free = free_disk_bytes(path.parent)
    if free < least:
        raise UserError(f"can't write {path}: it takes {least / 2 ** 20:.0f} MiB, and "
                        f"{free / 2 ** 20:.0f} MiB are free there; free some space or choose "
                        "another output with --out")


@contextlib.contextmanager
def row_file(path: Path, width: int, height: int, dpi: float, *, grey: bool = False,
             note: str = "") -> Iterator[RowFile]:
    """Open a TIFF or PNG, by its suffix; it appears under its name when all rows are written."""
    check_file(path, width, height, grey=grey)
    kind = TiffRows if path.suffix.lower() in _TIFF else PngRows
    with atomic_write(path) as stream:
        rows = kind(stream, width, height, dpi, grey=grey, note=note)
        yield rows
        rows.end()
