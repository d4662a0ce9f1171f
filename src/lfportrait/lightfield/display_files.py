"""Files of displays: TOML that a person can write, and the calibrations of Looking Glass panels.

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
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..files import read_json

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


def _calibrated(calibration: dict[str, Any], key: str, default: float | None = None) -> float:
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
    return tuple(tuple(_calibrated(row, key) for key in _CELL) for row in rows)


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


def entries_of_calibration(calibration: dict[str, Any], *, views: int = 0, name: str = "",
               ) -> dict[str, Any]:
    """The arguments of a `Display` from the contents of ``visual.json``.

    Parameters
    ----------
    calibration : Entries, bare or each as ``{"value": ...}``.
    views : Number of views; that of the panel's customary quilt by default.
    name : Name of the display; its serial number by default.

    Returns
    -------
    entries : Of a panel for which `Display.view_of` equals the shader's value on every sub-pixel.
    """
    width = round(_calibrated(calibration, "screenW"))
    height = round(_calibrated(calibration, "screenH"))
    slope, dpi = _calibrated(calibration, "slope"), _calibrated(calibration, "DPI")
    if slope == 0 or dpi <= 0 or width < 1 or height < 1:
        raise UserError("the calibration's slope, DPI, screenW and screenH must not be 0")
    if _calibrated(calibration, "pitch") == 0:
        raise UserError("the calibration's pitch must not be 0")
    flip_x = _calibrated(calibration, "flipImageX", 0) >= 0.5
    flip_y = _calibrated(calibration, "flipImageY", 0) >= 0.5
    lens = _calibrated(calibration, "pitch") * (width / dpi) * math.cos(math.atan(1.0 / slope))
    tilt = height / (width * slope) * (-1 if flip_x else 1)
    pitch = 3.0 * width / lens if lens else math.inf
    if not math.isfinite(pitch) or pitch == 0:
        raise UserError("the calibration's pitch, slope, DPI and screenW give no pitch of lenses")
    # t falls by 1 / H from row to row: the top row's pixel middles lie at t = 1 - 1 / (2 H). Where
    # the panel shows its picture upside down, the row that is seen on top is the lowest.
    top, down = (0.5 / height, 1.0 / height) if flip_y else (1.0 - 0.5 / height, -1.0 / height)
    shift = tilt * down * lens * pitch
    phase = (0.5 / width + top * tilt) * lens - _calibrated(calibration, "center")
    cells = _cells(calibration)
    mode = round(_calibrated(calibration, "CellPatternMode", 0)) if cells else 0
    if not 0 <= mode < len(CELL_PATTERNS):
        raise UserError(f"the calibration's CellPatternMode {mode} is not known (0 to 4 are)")
    serial = str(_plain(calibration.get("serial")) or "")
    quilt = max(((len(start), size) for start, size in _QUILTS.items()
                 if serial.upper().startswith(start)), default=(0, None))[1]
    quilt = (_default_quilt(calibration) or quilt
             or _QUILTS_BY_WIDTH.get(width, (5, 9, 4096, 4096)))
    swapped = not cells and _calibrated(calibration, "flipSubp", 0) >= 0.5
    return {
        "width": width, "height": height, "views": views or quilt[0] * quilt[1],
        "pitch": abs(pitch), "slant": math.atan(shift / 3.0),
        "offset": (phase if pitch > 0 else -phase) * abs(pitch) % abs(pitch),
        "subpixels": "BGR" if swapped else "RGB",
        "cone": _calibrated(calibration, "viewCone", 40.0),
        "distance": 4.0, "inverted": (_calibrated(calibration, "invView", 0) >= 0.5) != (pitch < 0),
        "flip_x": flip_x, "flip_y": flip_y, "cells": cells, "cell_pattern": CELL_PATTERNS[mode],
        "panel_height": height / dpi * 0.0254, "quilt": quilt[:2], "quilt_size": quilt[2:],
        "calibrated": True, "name": name or serial or "looking-glass"}


def calibration_of(display: Any, dpi: float = 0.0) -> dict[str, Any]:
    """A panel in Looking Glass's terms: the inverse of `entries_of`.

    Parameters
    ----------
    display : The panel, a `Display`; its lenses must be slanted.
    dpi : Pixels per inch; from the panel's height by default, or 100 where that is not known.

    Returns
    -------
    calibration : Entries as ``visual.json`` has them.
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


_REQUIRED = ("width", "height", "views", "pitch")
_PAIRS = ("quilt", "quilt_size")


def load_entries(path: Path, kinds: dict[str, str]) -> dict[str, Any]:
    """Read a display file, or a calibration where the name ends in ``.json``.

    Parameters
    ----------
    path : The file.
    kinds : Names and types of a display's entries.

    Returns
    -------
    entries : Arguments of `Display`.

    Raises
    ------
    UserError
        If the file is missing or does not describe a display.
    """
    if path.suffix.lower() != ".json":
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise UserError(f"can't read the display file {path}: {error}") from error
        return entries_of(text, path.stem, kinds)
    data = read_json(path)
    if isinstance(data, dict):
        data = data.get("calibration", data)
    if not isinstance(data, dict):
        raise UserError(f"{path} is not a calibration file")
    return entries_of_calibration(data)


def entries_of(text: str, name: str, kinds: dict[str, str]) -> dict[str, Any]:
    """The arguments of the `Display` that a TOML text describes.

    ``name`` is for messages and where the text has none; ``kinds`` as in `load_entries`.
    """
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise UserError(f"the display file {name} is not valid TOML: {error}") from error
    data.setdefault("name", name)
    if "slant_degrees" in data:
        degrees = data.pop("slant_degrees")
        if "slant" in data:
            raise UserError(f"the display file {name} has both slant and slant_degrees; keep one")
        data["slant"] = math.radians(_number(degrees, name, "slant_degrees"))
    unknown = sorted(set(data) - set(kinds))
    if unknown:
        raise UserError(f"the display file {name} has unknown entries: {', '.join(unknown)}")
    missing = [key for key in _REQUIRED if key not in data]
    if missing:
        raise UserError(f"the display file {name} lacks {', '.join(missing)}")
    return {key: _value(value, kinds[key], name, key) for key, value in data.items()}


def _number(value: Any, name: str, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise UserError(f"the display file {name}: {key} = {value!r} is not a number")
    try:
        return float(value)
    except OverflowError as error:
        raise UserError(f"the display file {name}: {key} is too large") from error


def _value(value: Any, kind: str, name: str, key: str) -> Any:
    """An entry of a display file as the data class wants it."""
    def wrong(wanted: str) -> UserError:
        return UserError(f"the display file {name}: {key} = {value!r} is not {wanted}")

    if key in _PAIRS:
        if not (isinstance(value, list) and len(value) == 2
                and all(type(entry) is int for entry in value)):
            raise wrong("two whole numbers")
        return tuple(value)
    if key == "cells":
        if not (isinstance(value, list) and all(isinstance(cell, list) for cell in value)):
            raise wrong("a list of rows of six numbers")
        return tuple(tuple(_number(entry, name, key) for entry in cell) for cell in value)
    if kind == "float":
        return _number(value, name, key)
    wanted = {"int": (int, "a whole number"), "str": (str, "a text"),
              "bool": (bool, "true or false")}[kind]
    if type(value) is not wanted[0]:
        raise wrong(wanted[1])
    return value


def text_of(display: Any) -> str:
    """A `Display` as a TOML text that `entries_of` reads back exactly."""
    lines = []
    for entry in fields(display):
        value = getattr(display, entry.name)
        if isinstance(value, bool):
            text = str(value).lower()
        elif isinstance(value, str):
            text = json.dumps(value)
        elif isinstance(value, tuple):
            text = str([list(row) if isinstance(row, tuple) else row for row in value])
        else:
            text = repr(value)
        note = f"  # radians; {math.degrees(value):.4f} degrees" if entry.name == "slant" else ""
        lines.append(f"{entry.name} = {text}{note}")
    return "\n".join(lines) + "\n"
