"""Marks in a print's border: they are cut off with the bleed when the sheet is laminated.

From the page's edge inwards: a little white; a strip of stripes as wide as half a lens; where to
cut, and a line of text. The stripes lie under the middle of each lens: to an eye straight in front
a strip is black all along where the sheet lies right, and checkered where it is turned. All of them
are black at once when the sheet is moved to where the picture is in its middle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..display import Display
from .sheet import Box, PrintSheet

__all__ = ["Marks", "lettering", "stripes"]

_WHITE, _STRIP, _CUT = 0.1, 0.5, 0.1
"""Shares of the margin: white, the strip, and white again before the marks where to cut."""
_LINE = 0.15
"""Width of a line in millimetres."""


def stripes(display: Display, rows: NDArray[np.int64], columns: NDArray[np.int64],
            ) -> NDArray[np.bool_]:
    """Where half of each lens is black, its middle: [rows, columns]."""
    phase = display.phase(rows[:, None], columns[None], 0) / display.pitch
    return np.asarray(np.abs(phase - 0.5) < 0.25)


def lettering(text: str, height: int, width: int, size: int, align: str = "center",
              ) -> NDArray[np.uint8]:
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
    """Paints a page's border, band by band.

    Attributes
    ----------
    sheet
        The page.
    text
        A line below the picture.
    """

    sheet: PrintSheet
    text: str = ""

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

    def paint(self, band: NDArray[np.uint8], first: int) -> None:
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

    def _cuts(self, band: NDArray[np.uint8], first: int) -> None:
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

    def _write(self, band: NDArray[np.uint8], first: int) -> None:
        """The line of text, below the picture."""
        height, width = self._words.shape
        top, left = self.sheet.picture.bottom, (self.sheet.display.width - width) // 2
        low, high = max(top, first), min(top + height, first + len(band))
        if high > low:
            band[low - first:high - first, left:left + width] = self._words[
                low - top:high - top, :, None]
