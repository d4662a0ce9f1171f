"""Pages: prints with their marks, test pages, and lenses, written band by band in little memory.

What the marks and the rows of a test page show is in docs/prints.md. From the page's edge inwards:
a little white; a strip of stripes as wide as half a lens, one under the middle of each lens; where
to cut, and a line of text. Rows of a test page differ in pitch; the lower ones have one pitch and
are moved from row to row by a tenth of a lens.

Lenses that are to be sharp on the ink below them have the radius R = t (n - 1) / n at their top,
for a sheet t thick of refractive index n. ``arc`` is that circle; ``sine`` has its curvature at the
top and is smooth between the lenses, which varnish keeps better.

TIFF and PNG files are written row by row: pages are larger than memory should be. Both formats
carry the resolution and an sRGB profile. TIFF: one strip a band, uncompressed, which every print
program reads at once. PNG: by all cores (`lfportrait.png`).
"""

from __future__ import annotations

import contextlib
import functools
import math
import struct
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np

from ...arrays import Bool, Float64, Int64, UInt8, Unsigned
from ...errors import UserError
from ...field import VoxelField
from ...files import atomic_write
from ...measure import free_disk_bytes
from ...png import PngWriter
from ...progress import Progress
from ..coding import composed, encode_rows, row_views
from ..display import Display
from ..ground import ground_of
from ..placement import EncodeConfig
from .depth import fitted
from .sheet import INCH, Box, PrintConfig, PrintSheet, paper_size

_WHITE, _STRIP, _CUT = 0.1, 0.5, 0.1
"""Shares of the margin: white, the strip, and white again before the marks where to cut."""
_LINE = 0.15  # Width of a line in millimetres.


def stripes(display: Display, rows: Int64, columns: Int64) -> Bool:
    """Where half of each lens is black, its middle: [rows, columns]."""
    phase = display.phase(rows[:, None], columns[None], 0) / display.pitch
    return np.asarray(np.abs(phase - 0.5) < 0.25)


def lettering(text: str, height: int, width: int, size: int, align: str = "center") -> UInt8:
    """A line of text, black on white, uint8 [height, width]; letters shrink where it is narrow."""
    from PIL import Image, ImageDraw, ImageFont

    font = ImageFont.load_default(max(6, size))
    # Lengths do not quite grow with the size: leave a little room.
    long = font.getlength(text) * 1.03
    if long > width:
        font = ImageFont.load_default(max(6, int(size * width / long)))
    picture = Image.new("L", (width, height), 255)
    place, anchor = ((width / 2, "mm") if align == "center" else (0, "lm"))
    ImageDraw.Draw(picture).text((place, height / 2), text, 0, font, anchor=anchor)
    return np.asarray(picture)


@dataclass
class Marks:
    """Paints a page's border, band by band."""

    sheet: PrintSheet  # The page.
    text: str = ""  # A line below the picture.

    def __post_init__(self) -> None:
        sheet = self.sheet
        self._boxes = self._strips()
        edge = sheet.picture.left
        height = max(1, edge - round((_WHITE + _STRIP) * edge))
        self._words = lettering(self.text, height, max(1, sheet.trim.width // 2),
                                round(0.5 * height))
        self._alike = (stripes(sheet.display, np.zeros(1, np.int64),
                               np.arange(sheet.display.width))[0]
                       if sheet.display.alike else None)

    def _strips(self) -> list[Box]:
        """Where the stripes lie: above, below, left and right of the picture."""
        display, picture = self.sheet.display, self.sheet.picture
        outer = round(_WHITE * picture.left)
        inner = round((_WHITE + _STRIP) * picture.left)
        return [Box(picture.left, outer, picture.right, inner),
                Box(picture.left, display.height - inner, picture.right, display.height - outer),
                Box(outer, picture.top, inner, picture.bottom),
                Box(display.width - inner, picture.top, display.width - outer, picture.bottom)]

    def paint(self, band: UInt8, first: int) -> None:
        """Paint the border of some rows, uint8 [n, W, 3], from page row ``first`` on."""
        sheet, last = self.sheet, first + len(band)
        picture = sheet.picture
        band[:, :picture.left] = 255
        band[:, picture.right:] = 255
        band[:max(0, min(picture.top, last) - first)] = 255
        band[max(0, picture.bottom - first):] = 255
        if not sheet.config.marks or picture.left == 0:
            return
        for box in self._boxes:
            rows = np.arange(max(box.top, first), min(box.bottom, last))
            if len(rows):
                columns = np.arange(box.left, box.right)
                black = (self._alike[None, columns] if self._alike is not None
                         else stripes(sheet.display, rows, columns))
                band[rows[0] - first:rows[-1] + 1 - first, box.left:box.right] = np.where(
                    black, 0, 255)[..., None]
        self._cuts(band, first)
        self._write(band, first)

    def _cuts(self, band: UInt8, first: int) -> None:
        """Short lines at the corners of the finished print, outside of the bleed."""
        display, picture, trim = self.sheet.display, self.sheet.picture, self.sheet.trim
        start = round((_WHITE + _STRIP + _CUT) * picture.left)
        thick = max(1, self.sheet.pixels(_LINE))
        half, last = thick // 2, first + len(band)

        def fill(left: int, top: int, right: int, bottom: int) -> None:
            top, bottom = max(top, first) - first, min(bottom, last) - first
            if bottom > top:
                band[top:bottom, left:right] = 0

        for x in (trim.left, trim.right):
            for low, high in ((start, picture.top - half),
                              (picture.bottom + half, display.height - start)):
                fill(x - half, low, x - half + thick, high)
        for y in (trim.top, trim.bottom):
            for low, high in ((start, picture.left - half),
                              (picture.right + half, display.width - start)):
                fill(low, y - half, high, y - half + thick)

    def _write(self, band: UInt8, first: int) -> None:
        """The line of text, below the picture."""
        height, width = self._words.shape
        top, left = self.sheet.picture.bottom, (self.sheet.display.width - width) // 2
        low, high = max(top, first), min(top + height, first + len(band))
        if high > low:
            band[low - first:high - first, left:left + width] = self._words[
                low - top:high - top, :, None]

_BAND = 16 << 20  # Bytes of a band's pixels.


def bands(display: Display) -> Iterator[tuple[int, int]]:
    """First row and number of rows of the bands of a page."""
    rows = min(max(_BAND // (3 * display.width), 16), 1024)
    for first in range(0, display.height, rows):
        yield first, min(rows, display.height - first)


def coded_bands(field: VoxelField, display: Display, config: EncodeConfig,
                ) -> Iterator[tuple[int, UInt8]]:
    """First row and rows, uint8 [n, W, 3], of a page's bands."""
    views: Unsigned | None = None
    config = composed(field, display, config)
    ground = ground_of(field, display, config)
    for first, count in bands(display):
        if views is None or not display.alike:
            views = row_views(display, first, count)
        yield first, encode_rows(field, display, config, first, count, views=views[:count],
                                 ground=ground)


def write_print(field: VoxelField, sheet: PrintSheet, path: Path, progress: Progress | None = None,
                *, coding: EncodeConfig | None = None) -> dict[str, Any]:
    """Code a field for a lens sheet and write the page.

    Parameters
    ----------
    field : The (stylised) radiance field.
    sheet : Page and lens sheet.
    path : ``.tiff`` or ``.png``; it appears when it is complete.
    progress : Progress line.
    coding : How to place and code the head (`fitted`).

    Returns
    -------
    figures : Sizes and seconds for ``--json``.

    Raises
    ------
    UserError : If the file can't hold the page or be written, or the head can't be placed.
    """
    display, config = sheet.display, sheet.config
    check_file(path, display.width, display.height)
    start = time.perf_counter()
    coding = coding or fitted(field, sheet)[0]
    marks = Marks(sheet, f"{config.lpi:g} lpi, {config.dpi:g} dpi, seen from "
                  f"{sheet.distance:.0f} mm. Print at 100 %. Lenses upright, their middles on the "
                  "black stripes.")
    coded = 0.0
    with row_file(path, display.width, display.height, config.dpi,
                  note=f"lenticular print, {config.lpi:g} lpi") as rows:
        clock = time.perf_counter()
        for first, band in coded_bands(field, display, coding):
            coded += time.perf_counter() - clock
            marks.paint(band, first)
            rows.write(band[:, ::-1] if config.mirror else band)
            if progress is not None:
                progress.step(f"{display.width} x {display.height} pixels", len(band))
            clock = time.perf_counter()
    return {"width": display.width, "height": display.height, "dpi": config.dpi,
            "pitch_subpixels": display.pitch, "pixels_per_lens": sheet.pixels_per_lens,
            "distance_mm": sheet.distance, "angle": display.cone,
            "thickness_mm": sheet.thickness, "bytes": path.stat().st_size,
            "seconds": {"coding": round(coded, 4), "page": round(time.perf_counter() - start, 4)}}


Profile = Literal["arc", "sine"]


def lens_heights(sheet: PrintSheet, profile: Profile, rows: Int64) -> Float64:
    """Height of the sheet above the ink over each pixel's middle, mm, float64 [rows, W]."""
    display, config = sheet.display, sheet.config
    lens = display.pitch / 3.0 / config.dpi * 25.4
    radius = sheet.thickness * (config.index - 1) / config.index
    if profile == "arc" and 2 * radius < lens:
        least = 0.5 * lens * config.index / (config.index - 1)
        raise UserError(f"round lenses of {config.lpi:g} lpi need a sheet of at least "
                        f"{least:.2f} mm to be sharp on the ink, not {sheet.thickness:.2f}: give "
                        "--thickness, or --lens-profile sine")
    away = lens * (display.phase(rows[:, None], np.arange(display.width)[None], 0)
                   / display.pitch - 0.5)
    if profile == "arc":
        return np.asarray(sheet.thickness - radius + np.sqrt(radius ** 2 - away ** 2))
    swing = (lens / (2 * math.pi)) ** 2 / radius
    return np.asarray(sheet.thickness - swing * (1 - np.cos(2 * math.pi * away / lens)))


def write_lenses(sheet: PrintSheet, path: Path, profile: Profile = "arc") -> dict[str, Any]:
    """Write the height map of the sheet that fits a print, with lenses of a cross-section.

    ``path`` is a ``.png`` or ``.tiff``, grey with 16 bits, of the page's size: 0 is the ink, 65535
    the top of a lens. Returns ``height_mm``, what 65535 stands for, and ``lens_mm``, the height of
    a lens in it.
    """
    display, config = sheet.display, sheet.config
    first = lens_heights(sheet, profile, np.zeros(1, np.int64))
    if float(first.min()) <= 0:
        raise UserError(f"such lenses would be higher than the sheet of {sheet.thickness:.2f} mm: "
                        "check --thickness and --angle")
    note = f"65535 is {sheet.thickness:.3f} mm; {config.lpi:g} lpi, {profile}"
    with row_file(path, display.width, display.height, config.dpi, grey=True, note=note) as out:
        for start, count in bands(display):
            heights = (first if display.alike
                       else lens_heights(sheet, profile, np.arange(start, start + count)))
            values = np.broadcast_to(np.rint(heights / sheet.thickness * 65535).astype(np.uint16),
                                     (count, display.width))
            out.write(values[:, ::-1] if config.mirror else values)
    return {"height_mm": sheet.thickness, "lens_mm": float(np.ptp(first)), "profile": profile}


_PITCHES, _PHASES = 21, 10
_DRIFT = 0.6  # Lenses by which neighbouring rows drift apart from end to end; half a lens is black.
_LEAST = 100.0  # Millimetres of a test page's sides at least.
_TEXT = 5.5  # Height of a line of text in millimetres, on pages high enough.
_EDGE = 5.0  # White at the page's edges, mm: printers leave it out.
_LABEL = 19.0  # Width of the labels, mm.


@dataclass(frozen=True)
class _Line:
    """Something that takes some rows of the page: a line of text, or stripes with a label."""

    top: int
    height: int
    text: str
    sheet: PrintSheet | None = None


@dataclass(frozen=True)
class TrialPage:
    """A test page."""

    sheet: PrintSheet  # Page and lens sheet in its middle, without borders.
    # pitches, phases: What the rows stand for, lenses per inch and lenses.
    pitches: tuple[float, ...]
    phases: tuple[float, ...]
    lines: tuple[_Line, ...]  # From the top down.

    @staticmethod
    def of(config: PrintConfig, spread: float = 0.0) -> TrialPage:
        """The page of a configuration; rows differ by up to ``spread`` per cent in pitch.

        0: so that a row whose pitch is that of the next one is white at both ends.
        """
        if not (spread == 0 or 0.05 <= spread <= 10):
            raise UserError("--pitch-range must be 0, or lie between 0.05 and 10 per cent, not "
                            f"{spread:g}")
        sheet = PrintSheet.of(config, bare=True)
        wide, high = paper_size(config.size)
        if min(wide, high) < _LEAST:
            raise UserError(f"a test page must be at least {_LEAST:g} x {_LEAST:g} mm large, not "
                            f"{wide:.0f} x {high:.0f}: choose a larger --size")
        if not spread:
            lenses = (wide - _LABEL - 2 * _EDGE) / INCH * config.lpi
            spread = 100 * _DRIFT / lenses * (_PITCHES // 2)
        pitches = tuple(config.lpi * (1 + spread / 100 * step)
                        for step in np.linspace(-1, 1, _PITCHES))
        phases = tuple(round(float(step), 2) for step in np.arange(-5, 5) / _PHASES)
        return TrialPage(sheet, pitches, phases,
                         tuple(_layout(config, sheet, pitches, phases, high)))

    def rows(self, first: int, count: int) -> UInt8:
        """Some rows of the page, uint8 [count, W]: black and white."""
        page = np.full((count, self.sheet.display.width), 255, np.uint8)
        for line in self.lines:
            low, high = max(line.top, first), min(line.top + line.height, first + count)
            if high > low:
                page[low - first:high - first] = self._line(line, low, high)
        return page

    def _line(self, line: _Line, low: int, high: int) -> UInt8:
        """Rows ``low`` to ``high`` of the page within a line."""
        width, edge = self.sheet.display.width, self.sheet.pixels(_EDGE)
        out = np.full((high - low, width), 255, np.uint8)
        start = edge
        if line.sheet is not None:
            start = edge + self.sheet.pixels(_LABEL)
            rows = np.arange(low, high) if not line.sheet.display.alike else np.zeros(1, np.int64)
            out[:, start:width - edge] = np.where(
                stripes(line.sheet.display, rows, np.arange(start, width - edge)), 0, 255)
            start -= self.sheet.pixels(1.0)
        words = lettering(line.text, line.height, (start if line.sheet else width - edge) - edge,
                          round(0.72 * line.height), "left")
        place = slice(edge, edge + words.shape[1])
        out[:, place] = words[low - line.top:high - line.top]
        return out


def _layout(config: PrintConfig, sheet: PrintSheet, pitches: tuple[float, ...],
            phases: tuple[float, ...], high: float) -> Iterator[_Line]:
    """What stands where on the page, from the top down."""
    above = (
        f"Pitch and phase of a lens sheet of {config.lpi:g} lpi, {config.dpi:g} dpi",
        "1. Print this page at 100 %, as it is. Lay the sheet on it, lenses upright.",
        f"2. One eye, straight in front of the middle, {sheet.distance:.0f} mm away.",
        "3. Turn the sheet until no row has slanted bars.",
        "4. The row that has one color all along has the right pitch: its number is --lpi.")
    below = (
        f"5. Print again with the pitch found. These rows have {config.lpi:g} lpi.",
        "The one that is black, and turns white alike as you move left or right, is --phase.")
    text = min(_TEXT, 0.3 * high / (len(above) + len(below)))
    band = (high - 2 * _EDGE - text * (len(above) + len(below)) - 3.0) / (_PITCHES + _PHASES)
    place = _EDGE

    def line(height: float, words: str, own: PrintConfig | None = None) -> _Line:
        nonlocal place
        top = sheet.pixels(place)
        place += height
        # Stripes have a little white between them.
        white = 0.15 * height if own else 0.0
        return _Line(top, sheet.pixels(place - white) - top, words,
                     PrintSheet.of(own, bare=True) if own else None)

    for words in above:
        yield line(text, words)
    for pitch in pitches:
        yield line(band, f"{pitch:.3f}", replace(config, lpi=pitch, phase=0.0))
    place += 3.0
    for words in below:
        yield line(text, words)
    for phase in phases:
        yield line(band, f"{phase:+.1f}", replace(config, phase=phase))


def write_pitch_test(config: PrintConfig, path: Path, spread: float = 0.0) -> dict[str, Any]:
    """Write a test page for pitch and phase, a ``.tiff`` or ``.png``.

    The configuration's pitch is in the middle of those tried; ``spread`` as for `TrialPage.of`.
    Returns ``pitches`` and ``phases`` of the rows from the top down.
    """
    page = TrialPage.of(config, spread)
    display = page.sheet.display
    with row_file(path, display.width, display.height, config.dpi,
                  note=f"pitch test, {config.lpi:g} lpi") as out:
        for first, count in bands(display):
            rows = page.rows(first, count)
            rows = rows[:, ::-1] if config.mirror else rows
            out.write(np.repeat(rows[..., None], 3, axis=2))
    return {"width": display.width, "height": display.height, "pitches": page.pitches,
            "phases": page.phases}


_TIFF, _PNG = (".tif", ".tiff"), (".png",)
_HEAD = 1 << 16  # Bytes that a TIFF's entries may take.
_TIFF_MOST = (1 << 32) - 1  # A TIFF's places are 32-bit numbers.
_LEAST_SHARE = 0.02  # Of a PNG's pixels' bytes, what its file takes at least.


@functools.cache
def srgb_profile() -> bytes:
    """An ICC profile of sRGB."""
    from PIL import ImageCms

    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


class RowFile:
    """A picture's file that takes rows from the top down, in a stream that can be sought.

    ``grey``: one channel of 16 bits, a measure and no color; else sRGB, 3 channels of 8 bits.
    """

    def __init__(self, stream: BinaryIO, width: int, height: int, dpi: float, *,
                 grey: bool = False, note: str = "") -> None:
        self.stream, self.width, self.height, self.dpi = stream, width, height, dpi
        self.grey, self.note = grey, note
        self.rows = 0
        self._begin()

    def write(self, rows: Unsigned) -> None:
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

    def _append(self, rows: Unsigned) -> None:
        raise NotImplementedError

    def _finish(self) -> None:
        raise NotImplementedError


class TiffRows(RowFile):
    """A baseline TIFF, little-endian, each call of `write` a strip of as many rows as the first."""

    def _begin(self) -> None:
        self._strips: list[tuple[int, int]] = []
        self._strip_rows = 0
        self.stream.write(b"II*\0\0\0\0\0")

    def _append(self, rows: Unsigned) -> None:
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

    def _append(self, rows: Unsigned) -> None:
        self._png.write(rows)

    def _finish(self) -> None:
        self._png.end()


def check_file(path: Path, width: int, height: int, *, grey: bool = False) -> None:
    """Refuse a file that can't hold a page, before anything is computed."""
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
