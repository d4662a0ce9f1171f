"""Conversion of Looking Glass calibrations to and from displays.

With s, t in [0, 1] over the panel from its lower left corner, the published shaders compute for
sub-pixel k (0 red, 1 green, 2 blue)::

    pitch' = pitch (screenW / DPI) cos(atan(1 / slope)),     tilt = screenH / (screenW slope)
    a = fract((s + k / (3 screenW) + t tilt) pitch' - center),      view = floor(a views)

with 1 - a in place of a where ``invView`` is set, and k counted from blue where ``flipSubp`` is.
The panels of 2024 replace k / (3 screenW) by ``subpixelCells``: for each color its place in x and
y, from the pixel's middle; ``CellPatternMode`` selects the cell of a pixel. Its numbers 2 and 4
are rows and columns here, as in the maker's present software; some of the older took them the
other way round.

``flipImageX`` and ``flipImageY`` belong to panels that show their picture mirrored. As HoloPlay's
shader does, s then runs from the right and tilt changes its sign, and the picture is mirrored in t,
while the lens keeps its own t.
"""

from __future__ import annotations

import json
import math
from typing import Any

from ..errors import UserError

__all__ = ["CELL_PATTERNS", "calibration_of", "customary_views", "entries_of"]

CELL_PATTERNS = ("single", "checkerboard", "rows", "staggered", "columns")
"""Which of the cells a pixel has; the places in this list are Looking Glass's numbers."""

_CELL = ("ROffsetX", "ROffsetY", "GOffsetX", "GOffsetY", "BOffsetX", "BOffsetY")

# Customary quilts by the beginning of the serial number: columns, rows, width, height. Panels
# without a known one get theirs by the width of the panel.
_QUILTS = {
    "LKG-2K": (5, 9, 4096, 4096), "LKG-4K": (5, 9, 4096, 4096), "LKG-8K": (5, 9, 8192, 8192),
    "LKG-PORT": (8, 6, 3360, 3360), "LKG-P": (8, 6, 3360, 3360), "LKG-A": (5, 9, 4096, 4096),
    "LKG-B": (5, 9, 8192, 8192), "LKG-D": (8, 9, 8192, 8192), "LKG-E": (11, 6, 4092, 4092),
    "LKG-F": (11, 6, 4092, 4092), "LKG-H": (11, 6, 5995, 6000), "LKG-J": (7, 7, 5999, 5999),
    "LKG-K": (11, 6, 8184, 8184), "LKG-L": (7, 7, 8190, 8190)}
_QUILTS_BY_WIDTH = {1536: (8, 6, 3360, 3360), 1440: (11, 6, 4092, 4092)}


def customary_views() -> dict[str, int]:
    """Views of each model's customary quilt.

    Returns
    -------
    views
        By the beginning of the serial number, or, for models without a known one, by the panel's
        width in pixels as text.
    """
    known = {**_QUILTS, **{str(width): quilt for width, quilt in _QUILTS_BY_WIDTH.items()}}
    return {start: quilt[0] * quilt[1] for start, quilt in known.items()}


def _plain(entry: Any) -> Any:
    return entry.get("value") if isinstance(entry, dict) else entry


def _number(calibration: dict[str, Any], key: str, default: float | None = None) -> float:
    entry = _plain(calibration.get(key, default))
    if entry is None:
        raise UserError(f"the calibration lacks {key!r}")
    try:
        value = float(entry)
    except (TypeError, ValueError, OverflowError) as error:
        raise UserError(f"the calibration's {key!r} is not a number: {entry!r}") from error
    if not math.isfinite(value):
        raise UserError(f"the calibration's {key!r} is not a number: {entry!r}")
    return value


def _cells(calibration: dict[str, Any]) -> tuple[tuple[float, ...], ...]:
    rows = _plain(calibration.get("subpixelCells"))
    if not rows:
        return ()
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise UserError("the calibration's 'subpixelCells' is not a list of cells")
    return tuple(tuple(_number(row, key) for key in _CELL) for row in rows)


def _default_quilt(calibration: dict[str, Any]) -> tuple[int, int, int, int] | None:
    """The quilt that a panel itself asks for: columns, rows, width, height; None if it says none.

    ``defaultQuilt`` is an object with ``tileX``, ``tileY``, ``quiltX`` and ``quiltY``, or that as
    a text.
    """
    entry = calibration.get("defaultQuilt")
    if isinstance(entry, dict) and "value" in entry:
        entry = entry["value"]
    if isinstance(entry, str):
        try:
            entry = json.loads(entry)
        except (ValueError, RecursionError):
            return None
    if not isinstance(entry, dict):
        return None
    try:
        columns, rows, width, height = (round(float(entry[key])) for key in (
            "tileX", "tileY", "quiltX", "quiltY"))
    except (KeyError, TypeError, ValueError, OverflowError):
        return None
    sensible = 1 <= columns <= width <= 32768 and 1 <= rows <= height <= 32768
    return (columns, rows, width, height) if sensible else None


def entries_of(calibration: dict[str, Any], *, views: int = 0, name: str = "",
               ) -> dict[str, Any]:
    """The arguments of a `Display` from the contents of ``visual.json``.

    Parameters
    ----------
    calibration
        Entries, bare or each as ``{"value": ...}``.
    views
        Number of views; that of the panel's customary quilt by default.
    name
        Name of the display; its serial number by default.

    Returns
    -------
    entries
        Of a panel for which `Display.view_of` equals the shader's value on every sub-pixel.
    """
    width = round(_number(calibration, "screenW"))
    height = round(_number(calibration, "screenH"))
    slope, dpi = _number(calibration, "slope"), _number(calibration, "DPI")
    if slope == 0 or dpi <= 0 or width < 1 or height < 1:
        raise UserError("the calibration's slope, DPI, screenW and screenH must not be 0")
    if _number(calibration, "pitch") == 0:
        raise UserError("the calibration's pitch must not be 0")
    flip_x = _number(calibration, "flipImageX", 0) >= 0.5
    flip_y = _number(calibration, "flipImageY", 0) >= 0.5
    lens = _number(calibration, "pitch") * (width / dpi) * math.cos(math.atan(1.0 / slope))
    tilt = height / (width * slope) * (-1 if flip_x else 1)
    pitch = 3.0 * width / lens if lens else math.inf
    if not math.isfinite(pitch) or pitch == 0:
        raise UserError("the calibration's pitch, slope, DPI and screenW give no pitch of lenses")
    # t falls by 1 / H from row to row: the top row's pixel middles lie at t = 1 - 1 / (2 H). Where
    # the panel shows its picture upside down, the row that is seen on top is the lowest.
    top, down = (0.5 / height, 1.0 / height) if flip_y else (1.0 - 0.5 / height, -1.0 / height)
    shift = tilt * down * lens * pitch
    phase = (0.5 / width + top * tilt) * lens - _number(calibration, "center")
    cells = _cells(calibration)
    mode = round(_number(calibration, "CellPatternMode", 0)) if cells else 0
    if not 0 <= mode < len(CELL_PATTERNS):
        raise UserError(f"the calibration's CellPatternMode {mode} is not known (0 to 4 are)")
    serial = str(_plain(calibration.get("serial")) or "")
    quilt = max(((len(start), size) for start, size in _QUILTS.items()
                 if serial.upper().startswith(start)), default=(0, None))[1]
    quilt = (_default_quilt(calibration) or quilt
             or _QUILTS_BY_WIDTH.get(width, (5, 9, 4096, 4096)))
    swapped = not cells and _number(calibration, "flipSubp", 0) >= 0.5
    return {
        "width": width, "height": height, "views": views or quilt[0] * quilt[1],
        "pitch": abs(pitch), "slant": math.atan(shift / 3.0),
        "offset": (phase if pitch > 0 else -phase) * abs(pitch) % abs(pitch),
        "subpixels": "BGR" if swapped else "RGB", "cone": _number(calibration, "viewCone", 40.0),
        "distance": 4.0, "inverted": (_number(calibration, "invView", 0) >= 0.5) != (pitch < 0),
        "flip_x": flip_x, "flip_y": flip_y, "cells": cells, "cell_pattern": CELL_PATTERNS[mode],
        "panel_height": height / dpi * 0.0254, "quilt": quilt[:2], "quilt_size": quilt[2:],
        "calibrated": True, "name": name or serial or "looking-glass"}


def calibration_of(display: Any, dpi: float = 0.0) -> dict[str, Any]:
    """A panel in Looking Glass's terms: the inverse of `entries_of`.

    Parameters
    ----------
    display
        The panel, a `Display`; its lenses must be slanted.
    dpi
        Pixels per inch; from the panel's height by default, or 100 where that is not known.

    Returns
    -------
    calibration
        Entries as ``visual.json`` has them.
    """
    if display.slant == 0:
        raise UserError("a panel with vertical lenses has no finite Looking Glass slope")
    if dpi <= 0:
        inches = display.panel_height / 0.0254
        dpi = display.height / inches if inches > 0 else 100.0
    lens = 3.0 * display.width / display.pitch
    height = display.height
    top, down = (0.5 / height, 1.0 / height) if display.flip_y else (
        1.0 - 0.5 / height, -1.0 / height)
    tilt = display.shift / (display.pitch * lens * down)
    phase = (0.5 / display.width + top * tilt) * lens
    slope = height / (display.width * tilt) * (-1 if display.flip_x else 1)
    values: dict[str, float] = {
        "pitch": lens * dpi / display.width / math.cos(math.atan(1.0 / slope)), "slope": slope,
        "center": (phase - display.offset / display.pitch) % 1.0, "viewCone": display.cone,
        "invView": float(display.inverted), "verticalAngle": 0.0, "DPI": dpi,
        "screenW": float(display.width), "screenH": float(display.height),
        "flipImageX": float(display.flip_x), "flipImageY": float(display.flip_y),
        "flipSubp": float(display.subpixels == "BGR")}
    calibration: dict[str, Any] = {key: {"value": value} for key, value in values.items()}
    calibration["serial"] = display.name
    if display.cells:
        calibration["CellPatternMode"] = {
            "value": float(CELL_PATTERNS.index(display.cell_pattern))}
        calibration["subpixelCells"] = [dict(zip(_CELL, cell)) for cell in display.cells]
    return calibration
