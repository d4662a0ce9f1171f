"""Writing a print: coded, marked and written band by band, so that memory stays small."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...field import VoxelField
from ...progress import Progress
from ..coding import encode_rows
from ..composition import composed
from ..display import Display
from ..ground import ground_of
from ..mask import row_views
from ..placement import EncodeConfig
from .depth import fitted
from .files import check_file, row_file
from .marks import Marks
from .sheet import PrintSheet

__all__ = ["bands", "coded_bands", "write_print"]

_BAND = 16 << 20
"""Bytes of a band's pixels."""


def bands(display: Display) -> Iterator[tuple[int, int]]:
    """First row and number of rows of the bands of a page."""
    rows = min(max(_BAND // (3 * display.width), 16), 1024)
    for first in range(0, display.height, rows):
        yield first, min(rows, display.height - first)


def coded_bands(field: VoxelField, display: Display, config: EncodeConfig,
                ) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """First row and rows, uint8 [n, W, 3], of a page's bands."""
    views: NDArray[np.unsignedinteger] | None = None
    config = composed(field, display, config)
    ground = ground_of(field, display, config)
    for first, count in bands(display):
        if views is None or not display.alike:
            views = row_views(display, first, count)
        yield first, encode_rows(field, display, config, first, count, views=views[:count],
                                 ground=ground)


def write_print(field: VoxelField, sheet: PrintSheet, path: Path,
                progress: Progress | None = None, *, coding: EncodeConfig | None = None,
                ) -> dict[str, Any]:
    """Code a field for a lens sheet and write the page.

    Parameters
    ----------
    field
        The (stylised) radiance field.
    sheet
        Page and lens sheet.
    path
        ``.tiff`` or ``.png``; it appears when it is complete.
    progress
        Progress line.
    coding
        How to place and code the head (`fitted`).

    Returns
    -------
    figures
        Sizes and seconds for ``--json``.

    Raises
    ------
    UserError
        If the file can't hold the page or be written, or the head can't be placed.
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
