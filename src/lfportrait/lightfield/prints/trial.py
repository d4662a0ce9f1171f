"""A test page: which pitch and which phase fit a sheet of lenses, on this printer.

Each row has stripes under the middle of each lens, for another pitch. Seen through the sheet, a row
whose pitch is wrong turns from black to white and back along its length; the right one is black all
along, to an eye straight in front. The lower rows have one pitch and are moved from row to row by a
tenth of a lens: they tell where the sheet lies.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from .config import PrintConfig
from .files import check_file, row_file
from .marks import lettering, stripes
from .pages import bands
from .sheet import PrintSheet
from .sizes import INCH, paper_size

__all__ = ["TrialPage", "write_pitch_test"]

_PITCHES, _PHASES = 21, 10
_DRIFT = 0.6
"""Lenses by which neighbouring rows drift apart from end to end; half a lens is black."""
_LEAST = 100.0
"""Millimetres of a test page's sides at least."""
_TEXT = 5.5
"""Height of a line of text in millimetres, on pages high enough."""
_EDGE = 5.0
"""White at the page's edges, mm: printers leave it out."""
_LABEL = 19.0
"""Width of the labels, mm."""


@dataclass(frozen=True)
class _Line:
    """Something that takes some rows of the page: a line of text, or stripes with a label."""

    top: int
    height: int
    text: str
    sheet: PrintSheet | None = None


@dataclass(frozen=True)
class TrialPage:
    """A test page.

    Attributes
    ----------
    sheet
        Page and lens sheet in its middle, without borders.
    pitches, phases
        What the rows stand for, lenses per inch and lenses.
    lines
        From the top down.
    """

    sheet: PrintSheet
    pitches: tuple[float, ...]
    phases: tuple[float, ...]
    lines: tuple[_Line, ...]

    @staticmethod
    def of(config: PrintConfig, spread: float = 0.0) -> TrialPage:
        """The page of a configuration; rows differ by up to ``spread`` per cent in pitch.

        0: so that a row whose pitch is that of the next one is white at both ends.

        Raises
        ------
        UserError
            If the page is smaller than 100 mm.
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

    def rows(self, first: int, count: int) -> NDArray[np.uint8]:
        """Some rows of the page, uint8 [count, W]: black and white."""
        page = np.full((count, self.sheet.display.width), 255, np.uint8)
        for line in self.lines:
            low, high = max(line.top, first), min(line.top + line.height, first + count)
            if high > low:
                page[low - first:high - first] = self._line(line, low, high)
        return page

    def row_of(self, number: int) -> tuple[int, int]:
        """First page row of the ``number``-th stripes, pitches first, and how many it has."""
        line = [line for line in self.lines if line.sheet is not None][number]
        return line.top, line.height

    def _line(self, line: _Line, low: int, high: int) -> NDArray[np.uint8]:
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
    """Write a test page for pitch and phase.

    Parameters
    ----------
    config
        Page and lens sheet; its pitch is in the middle of those tried.
    path
        ``.tiff`` or ``.png``.
    spread
        Per cent by which the rows' pitches differ from it at most; 0: as the page's width needs.

    Returns
    -------
    figures
        ``pitches`` and ``phases`` of the rows from the top down.
    """
    page = TrialPage.of(config, spread)
    display = page.sheet.display
    check_file(path, display.width, display.height)
    with row_file(path, display.width, display.height, config.dpi,
                  note=f"pitch test, {config.lpi:g} lpi") as out:
        for first, count in bands(display):
            rows = page.rows(first, count)
            rows = rows[:, ::-1] if config.mirror else rows
            out.write(np.repeat(rows[..., None], 3, axis=2))
    return {"width": display.width, "height": display.height, "pitches": page.pitches,
            "phases": page.phases}
