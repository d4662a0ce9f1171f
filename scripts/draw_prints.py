"""Draw docs/images/prints.jpg: a lenticular print, what an eye sees of it, and its test page.

.venv/bin/python scripts/draw_prints.py demo-out/styled.npz
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lfportrait.field import VoxelField
from lfportrait.files import write_image
from lfportrait.lightfield import encode_rows
from lfportrait.lightfield.prints import PrintConfig, PrintSheet, SheetView, fitted, through_lenses
from lfportrait.lightfield.prints.pages import Marks, TrialPage

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "prints.jpg"
HEIGHT, GAP = 460, 12
TRUE_LPI = 60.31
"""Of the sheet on the test page, which is printed for 60.12."""


def corner(field: VoxelField, sheet: PrintSheet) -> NDArray[np.uint8]:
    """The lower left corner of the page with its marks, half as large."""
    display, config = sheet.display, fitted(field, sheet)[0]
    first = display.height - 2 * HEIGHT
    band = encode_rows(field, display, config, first, 2 * HEIGHT)
    Marks(sheet).paint(band, first)
    part = band[:, :2 * HEIGHT]
    return np.asarray(cv2.resize(part, (HEIGHT, HEIGHT), interpolation=cv2.INTER_AREA))


def middle(field: VoxelField, sheet: PrintSheet) -> NDArray[np.uint8]:
    """A piece of the face as it is printed, three times as large."""
    display, config = sheet.display, fitted(field, sheet)[0]
    size = -(-HEIGHT // 3)
    first, left = round(0.50 * display.height), round(0.40 * display.width)
    band = encode_rows(field, display, config, first, size)[:, left:left + size]
    return np.asarray(cv2.resize(band, (HEIGHT, HEIGHT), interpolation=cv2.INTER_NEAREST))


def trial(config: PrintConfig) -> NDArray[np.uint8]:
    """The test page under a sheet of another pitch, straight in front."""
    page = TrialPage.of(config)
    sheet = PrintSheet.of(replace(config, lpi=TRUE_LPI), bare=True).display
    rows = np.arange(0, sheet.height, 6)
    ink = np.concatenate([page.rows(int(row), 1) for row in rows])
    seen = through_lenses(np.repeat(ink[..., None], 3, 2), sheet, 0.0, rows)
    width = round(HEIGHT * sheet.width / sheet.height)
    return np.uint8(255 * cv2.resize(seen, (width, HEIGHT), interpolation=cv2.INTER_AREA) + 0.5)


def main() -> None:
    field = VoxelField.load(sys.argv[1])
    config = PrintConfig(lpi=60.12, background=0.6, head=0.9, relief=1.5)
    sheet = PrintSheet.of(config)
    view = SheetView.of(field, sheet, fitted(field, sheet)[0], 2 * HEIGHT)
    seen = [np.uint8(255 * cv2.resize(view.picture(share), (HEIGHT * 4 // 5, HEIGHT),
                                      interpolation=cv2.INTER_AREA) + 0.5)
            for share in (-0.4, 0.4)]
    parts = [corner(field, sheet), middle(field, sheet), *seen, trial(config)]
    white = np.full((HEIGHT, GAP, 3), 255, np.uint8)
    joined = [piece for part in parts for piece in (white, part)][1:]
    write_image(PICTURE, np.concatenate(joined, 1), quality=88)


if __name__ == "__main__":
    main()
