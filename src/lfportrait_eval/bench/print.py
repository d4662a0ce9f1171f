"""A lenticular print coded by rays, and made the usual way, in one run.

The usual way: as many views as there are pixels under a lens, each a picture of 300 pixels per
inch; columns of them interlaced to a whole number of pixels a lens; the result resampled to the
printer's resolution. Here it gets the views from the fastest kernel there is for them, and the
exact phase of each of its columns; what is left is what the steps themselves cost and lose.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lfportrait.field import VoxelField
from lfportrait.lightfield import Display, EncodeConfig, encode_rows, render_view
from lfportrait.lightfield.prints import (
    PrintConfig,
    PrintSheet,
    fitted,
    through_lenses,
    write_print,
)
from lfportrait.measure import cost_of, memory_of
from lfportrait.metrics import psnr
from lfportrait.progress import Progress
from lfportrait.temporary import temporary_folder

from .transfer import say, timed

__all__ = ["bench_print"]

USUAL_PPI = 300.0
"""Pixels per inch of the views that studios interlace."""
EYES = 9
"""Places that what an eye sees is compared from."""


def bench_print(field: VoxelField, config: PrintConfig | None = None, *, repeats: int = 3,
                progress: Progress | None = None) -> dict[str, Any]:
    """Time, memory and quality of a print and of the usual way to make one.

    Parameters
    ----------
    field
        The field to print.
    config
        Page and lens sheet; by default 8 x 10 inches at 720 dpi without border, 60.12 lpi.
    repeats
        The shortest of so many runs counts.
    progress
        Progress line.

    Returns
    -------
    figures
        ``rays`` and ``usual``: ``seconds`` with the file written, ``cpu_seconds`` of all cores
        together, ``memory_bytes`` beyond the field's, ``psnr`` (dB) of what an eye sees through
        the lenses at nine places, the mean and the ``worst``, against the field rendered from
        there; ``usual`` also by its parts and ``times_slower``. ``pixels``,
        ``pixels_per_lens``, ``depth_scale``.
    """
    config = config or PrintConfig(lpi=60.12, bleed=0.0, margin=0.0)
    sheet = PrintSheet.of(config)
    display = sheet.display
    coding, depth = fitted(field, sheet)
    # A few rows compile the kernels before the clock starts.
    encode_rows(field, display, coding, 0, 8)
    figures: dict[str, Any] = {
        "pixels": display.width * display.height, "pixels_per_lens": sheet.pixels_per_lens,
        "depth_scale": depth.depth_scale}
    say(progress, "print by rays")
    with temporary_folder() as folder:
        path = folder / "print.tiff"
        # The first run tells the memory: later ones find some of it taken already.
        memory, (cost, _) = memory_of(
            lambda: cost_of(lambda: write_print(field, sheet, path, coding=coding)))
        seconds, run = timed(lambda: write_print(field, sheet, path, coding=coding), repeats)
        figures["rays"] = {"seconds": seconds, "cpu_seconds": cost.cpu_seconds,
                           "coding_seconds": run["seconds"]["coding"], "memory_bytes": memory}
        say(progress, "views, interlaced and resampled")
        memory, (cost, (parts, usual)) = memory_of(lambda: cost_of(
            lambda: _usual_way(field, sheet, coding, folder / "usual.tiff")))
    figures["usual"] = {"seconds": sum(parts.values()), "cpu_seconds": cost.cpu_seconds, **parts,
                        "memory_bytes": memory}
    figures["usual"]["times_slower"] = figures["usual"]["seconds"] / seconds
    say(progress, "what an eye sees")
    # Rows stand for themselves: every fourth one tells as much.
    rows = np.arange(0, display.height, 4)
    pages = {"rays": encode_rows(field, display, coding, 0, len(rows), 4), "usual": usual[rows]}
    for name, scores in _seen(field, display, coding, rows, pages).items():
        figures[name] |= {"psnr": float(np.mean(scores)), "worst": float(np.min(scores))}
    return figures


def _usual_way(field: VoxelField, sheet: PrintSheet, coding: EncodeConfig, path: Path,
               ) -> tuple[dict[str, float], NDArray[np.uint8]]:
    """Seconds of each step, and the page uint8 [H, W, 3]."""
    display = sheet.display
    count = round(sheet.pixels_per_lens)
    small = USUAL_PPI / sheet.config.dpi
    camera = replace(display, views=count, width=round(display.width * small),
                     height=round(display.height * small))
    parts: dict[str, float] = {}

    def step(name: str, work: Callable[[], Any]) -> Any:
        start = time.perf_counter()
        result = work()
        parts[f"{name}_seconds"] = time.perf_counter() - start
        return result

    views = step("views", lambda: [render_view(field, camera, view, coding)
                                   for view in range(count)])
    strips = step("interlace", lambda: _interlaced(views, display, count))
    page = step("resample", lambda: cv2.resize(strips, (display.width, display.height),
                                               interpolation=cv2.INTER_CUBIC))
    step("write", lambda: cv2.imwrite(str(path), page[..., ::-1],
                                      [cv2.IMWRITE_TIFF_COMPRESSION, 1]))
    return parts, np.asarray(page, np.uint8)


def _interlaced(views: list[NDArray[np.uint8]], display: Display, count: int,
                ) -> NDArray[np.uint8]:
    """A whole number of columns a lens, each of one view."""
    width = round(display.width / display.pitch * 3.0 * count)
    place = (np.arange(width) + 0.5) * display.width / width - 0.5
    share = np.mod((3.0 * place + display.offset) / display.pitch, 1.0)
    view = np.minimum(((1.0 - share) * count).astype(int), count - 1)
    out = np.empty((display.height, width, 3), np.uint8)
    for number, picture in enumerate(views):
        columns = view == number
        out[:, columns] = cv2.resize(picture, (width, display.height),
                                     interpolation=cv2.INTER_LINEAR)[:, columns]
    return out


def _seen(field: VoxelField, display: Display, coding: EncodeConfig, rows: NDArray[np.int64],
          pages: dict[str, NDArray[np.uint8]]) -> dict[str, list[float]]:
    """PSNR of each page from each eye.

    A lens is as wide as its strip of ink; a view may be compared at the ink or at the lens's
    middle. A page counts by what it fits better.
    """
    scores: dict[str, list[float]] = {name: [] for name in pages}
    last = display.views - 1
    # An eye nearer to the edge of the viewing angle sees something of its other edge, too.
    for view in np.linspace(0.1 * last, 0.9 * last, EYES).round().astype(int):
        truth = render_view(field, display, int(view), coding)[rows]
        eye = float(display.eyes()[view])
        targets = [through_lenses(truth, display, x, rows) for x in (eye, 0.0)]
        for name, page in pages.items():
            seen = through_lenses(page, display, eye, rows)
            inside = slice(1, -1)  # of the outermost lenses a part lies beyond the page
            found = max(psnr(seen[:, inside], target[:, inside]) for target in targets)
            scores[name].append(found if math.isfinite(found) else 99.0)
    return scores
