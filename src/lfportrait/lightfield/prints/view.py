"""What an eye sees through the lenses of a print.

Through each lens an eye sees one point of the strip of ink below it, and the whole lens in that
color. So a view has as many columns as there are lenses. Every row of a print stands for itself,
so some of them are enough for a small picture.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...field import VoxelField
from ..coding import encode_rows
from ..display import Display
from ..placement import EncodeConfig
from .depth import fitted
from .sheet import PrintSheet

__all__ = ["SheetView", "through_lenses"]


def through_lenses(coded: NDArray[np.uint8], display: Display, eye: float,
                   rows: NDArray[np.int64] | None = None, *, distance: float | None = None,
                   ) -> NDArray[np.float32]:
    """The color of each lens to an eye.

    Parameters
    ----------
    coded
        Rows of a coded page, uint8 [h, W, 3].
    display
        The lens sheet on the page. Where a page was coded for another pitch, as on test pages, that
        of the sheet that lies on it.
    eye
        x of the eye in half heights of the page.
    rows
        Which rows of the page they are, int64 [h]; by default the first ones.
    distance
        Distance of the eye; the viewing distance by default.

    Returns
    -------
    picture
        float32 [h, lenses, 3] in [0, 1], lenses from the left.
    """
    lines = np.arange(len(coded)) if rows is None else np.asarray(rows)
    far = display.distance if distance is None else distance
    middle = _lens_middles(display, lines)
    x = display.aspect * (2.0 * (middle + 0.5) / display.width - 1.0)
    received = x + (eye - x) * display.distance / far
    share = np.mod(0.5 * (received / display.eye_reach + 1.0), 1.0)
    if display.inverted:
        share = 1.0 - share
    place = np.clip(middle + (share - 0.5) * display.pitch / 3.0, 0, display.width - 1)
    column = np.minimum(place.astype(np.int64), max(display.width - 2, 0))
    part = (place - column)[..., None].astype(np.float32)
    light = ((np.arange(256) / 255.0) ** display.gamma).astype(np.float32)
    across = np.arange(len(coded))[:, None]
    after = np.minimum(column + 1, display.width - 1)
    mixed = (1 - part) * light[coded[across, column]] + part * light[coded[across, after]]
    return np.asarray(mixed ** np.float32(1.0 / display.gamma), np.float32)


def _lens_middles(display: Display, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Column of the middle of each lens, float64 [rows, lenses], from lens to lens a pitch on."""
    lens = display.pitch / 3.0
    # Of the lens in the page's middle; phase is half a pitch there.
    centre = 0.5 * (display.width - 1)
    phase = 3.0 * centre + rows * display.shift + display.offset
    first = centre + (0.5 * display.pitch - np.mod(phase, display.pitch)) / 3.0
    count = int(0.5 * display.width / lens)
    return np.asarray(first[:, None] + lens * np.arange(-count, count + 1))


@dataclass(frozen=True)
class SheetView:
    """A small copy of a print under its lenses: every n-th row, in full width.

    Attributes
    ----------
    sheet
        The page.
    rows
        Which rows, int64 [h].
    coded
        uint8 [h, W, 3].
    """

    sheet: PrintSheet
    rows: NDArray[np.int64]
    coded: NDArray[np.uint8]

    @staticmethod
    def of(field: VoxelField, sheet: PrintSheet, config: EncodeConfig | None = None,
           height: int = 960) -> SheetView:
        """Code about ``height`` rows of the finished print.

        Parameters
        ----------
        field, sheet
            As for `write_print`.
        config
            How to place and code the head; by default as `write_print` does.
        height
            About as many rows are coded.
        """
        config = config or fitted(field, sheet)[0]
        trim = sheet.trim
        apart = max(1, trim.height // height)
        rows = np.arange(trim.top, trim.bottom, apart)
        coded = encode_rows(field, sheet.display, config, int(rows[0]), len(rows), apart)
        return SheetView(sheet, rows, coded)

    def picture(self, eye: float) -> NDArray[np.float32]:
        """The finished print to an eye at a share of the viewing angle, -0.5 (left) to 0.5.

        Returns
        -------
        picture
            float32 [h, w, 3] in [0, 1].
        """
        display, trim = self.sheet.display, self.sheet.trim
        x = display.distance * math.tan(math.radians(display.cone) * eye)
        seen = through_lenses(self.coded, display, x, self.rows)
        middle = _lens_middles(display, self.rows)
        width = max(1, round(len(self.rows) * trim.width / trim.height))
        wanted = trim.left + (np.arange(width) + 0.5) * trim.width / width - 0.5
        lens = ((wanted[None] - middle[:, :1]) / (display.pitch / 3.0)).astype(np.float32)
        line = np.broadcast_to(np.arange(len(self.rows), dtype=np.float32)[:, None], lens.shape)
        return np.asarray(cv2.remap(seen, lens, np.ascontiguousarray(line), cv2.INTER_LINEAR,
                                    borderMode=cv2.BORDER_REPLICATE), np.float32)

    def sweep(self, frames: int = 90) -> Iterator[NDArray[np.float32]]:
        """Pictures of an eye that moves through nine tenths of the viewing angle and back."""
        for turn in np.arange(frames) * 2 * math.pi / frames:
            yield self.picture(0.45 * math.sin(turn))
