"""The height map of a lens sheet, for printers that print the lenses in varnish, too.

Lenses that are to be sharp on the ink below them have the radius R = t (n - 1) / n at their top,
for a sheet t thick of refractive index n. ``arc`` is that circle; ``sine`` has its curvature at the
top and is smooth between the lenses, which varnish keeps better.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ..display import Display
from .files import row_file
from .pages import bands
from .sheet import PrintSheet

__all__ = ["lens_heights", "write_lenses"]

Profile = Literal["arc", "sine"]


def lens_heights(sheet: PrintSheet, profile: Profile, rows: NDArray[np.int64],
                 ) -> NDArray[np.float64]:
    """Height of the sheet above the ink over each pixel's middle, mm, float64 [rows, W].

    Raises
    ------
    UserError
        If lenses of this pitch can't be sharp on a sheet so thin.
    """
    display, config = sheet.display, sheet.config
    lens = display.pitch / 3.0 / config.dpi * 25.4
    radius = sheet.thickness * (config.index - 1) / config.index
    if profile == "arc" and 2 * radius < lens:
        least = 0.5 * lens * config.index / (config.index - 1)
        raise UserError(f"round lenses of {config.lpi:g} lpi need a sheet of at least "
                        f"{least:.2f} mm to be sharp on the ink, not {sheet.thickness:.2f}: give "
                        "--thickness, or --lens-profile sine")
    away = lens * (_phase(display, rows) / display.pitch - 0.5)
    if profile == "arc":
        return np.asarray(sheet.thickness - radius + np.sqrt(radius ** 2 - away ** 2))
    swing = (lens / (2 * math.pi)) ** 2 / radius
    return np.asarray(sheet.thickness - swing * (1 - np.cos(2 * math.pi * away / lens)))


def _phase(display: Display, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    return display.phase(rows[:, None], np.arange(display.width)[None], 0)


def write_lenses(sheet: PrintSheet, path: Path, profile: Profile = "arc") -> dict[str, Any]:
    """Write the height map of the sheet that fits a print.

    Parameters
    ----------
    sheet
        Page and lens sheet.
    path
        ``.png`` or ``.tiff``, grey with 16 bits, of the page's size: 0 is the ink, 65535 the top of
        a lens.
    profile
        The lenses' cross-section.

    Returns
    -------
    figures
        ``height_mm``, what 65535 stands for, and ``lens_mm``, the height of a lens in it.
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
