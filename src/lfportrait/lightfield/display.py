"""A lenticular display: the view of each sub-pixel, from where it is seen, its files and pictures.

Display frame: origin at the panel's centre, x right, y up, z to the viewer; the unit is half the
panel's height. Sub-pixel k of column x and row y (rows from the top) has the phase under its lens,
in sub-pixels, and the view (Shen et al. 2023, Eq. 8, written for columns from the left)::

    u = (3 x + k + 3 y tan(slant) + offset) mod L_n,     v = u V_n / L_n  in [0, V_n)

The paper's value is v - V_n / 2 of the mirrored column.

Some panels do not have their sub-pixels side by side: ``cells`` then gives each color's place
within its pixel, and 3 (x + dx_k) - 3 tan(slant) dy_k takes the place of 3 x + k. Everything here
is as the viewer sees the panel; one that shows its picture mirrored (``flip_x``, ``flip_y``) gets
it mirrored beforehand, by `to_panel`: coded pictures are turned on the way to a file and back
(`write_coded`, `read_coded`), in memory they are as seen.

View v is seen from the point (x_v, eye_height, distance) on a horizontal line, with
x_v = distance tan(cone / 2) (2 (v + 1/2) / V_n - 1): view 0 is the leftmost.

Files are TOML that a person can write, or Looking Glass's calibrations, which state the same by
``pitch``, ``slope`` and ``center`` and are converted exactly. With s, t in [0, 1] over the panel
from its lower left corner, the published shaders compute for sub-pixel k (0 red, 1 green, 2 blue)::

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

import hashlib
import json
import math
import os
import tomllib
from dataclasses import dataclass, fields, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array, Float64, Int64, UInt8
from ..errors import UserError
from ..files import atomic_write, read_json, write_image
from ..media.pictures import read_image

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

    By the beginning of the serial number, or, for models without a known one, by the panel's width
    in pixels as text.
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
    """The quilt that a panel asks for, as object or text: columns, rows, width, height, or None."""
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

    `Display.view_of` then equals the shader's value on every sub-pixel.

    Parameters
    ----------
    calibration : Entries, bare or each as ``{"value": ...}``.
    views : Number of views; that of the panel's customary quilt by default.
    name : Name of the display; its serial number by default.
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


_REQUIRED = ("width", "height", "views", "pitch")
_PAIRS = ("quilt", "quilt_size")


def entries_of(text: str, name: str) -> dict[str, Any]:
    """The arguments of the `Display` that a TOML text describes.

    ``name`` is for messages and where the text has none.
    """
    kinds = {entry.name: str(entry.type) for entry in fields(Display)}
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


_ORDERS = ("RGB", "BGR")


@dataclass(frozen=True)
class Display:
    """A lenticular panel.

    Attributes
    ----------
    width, height : Panel size in pixels.
    views : V_n, number of views.
    pitch : L_n, sub-pixels under one lens along a row (may be fractional).
    slant : Angle of the lenses against the vertical in radians; positive shifts the phase to the
        right row by row, by 3 tan(slant) sub-pixels.
    offset : Phase of the top left sub-pixel (with ``cells``: of that pixel's middle), in
        sub-pixels.
    subpixels : Order of the colors from left to right, ``"RGB"`` or ``"BGR"``.
    cone : Angle in degrees between the outermost views.
    distance : Viewing distance in half panel heights.
    eye_height : Height of the eyes above the panel's centre, in half panel heights.
    inverted : True where the phase grows from the right to the left view.
    flip_x, flip_y : True where the panel shows its picture mirrored left to right, or upside
        down.
    cells : Up to four rows of six numbers, where a pixel's colors do not lie side by side: x and
        y of red, green and blue from the pixel's middle, in pixels, x to the right, y up.
    cell_pattern : Which row of ``cells`` a pixel has: ``"single"`` (the first), ``"columns"``,
        ``"rows"`` (in turn, columns from the left, rows from the bottom), ``"checkerboard"`` or
        ``"staggered"`` (rows in turn, every second column two rows further).
    gamma : Gamma of the panel, from stored value to light; cross-talk is computed in light.
    panel_height : Height of the panel in metres; 0 = unknown.
    quilt : Columns and rows of the customary quilt.
    quilt_size : Width and height of the customary quilt in pixels.
    calibrated : True if the lens was measured on this panel. Every panel differs: with the
        values of another one the picture is blurred, doubled or jumps.
    name, note : For people.
    """

    width: int
    height: int
    views: int
    pitch: float
    slant: float = 0.0
    offset: float = 0.0
    subpixels: str = "RGB"
    cone: float = 40.0
    distance: float = 4.0
    eye_height: float = 0.0
    inverted: bool = False
    flip_x: bool = False
    flip_y: bool = False
    cells: tuple[tuple[float, ...], ...] = ()
    cell_pattern: str = "single"
    gamma: float = 2.2
    panel_height: float = 0.0
    quilt: tuple[int, int] = (8, 6)
    quilt_size: tuple[int, int] = (3360, 3360)
    calibrated: bool = False
    name: str = "display"
    note: str = ""

    def __post_init__(self) -> None:
        def need(good: bool, text: str) -> None:
            if not good:
                raise UserError(f"display {self.name!r}: {text}")

        def between(value: float, low: float, high: float) -> bool:
            return math.isfinite(value) and low <= value <= high

        need(1 <= self.width <= 65536 and 1 <= self.height <= 65536,
             f"width and height must be 1 to 65536 pixels, not {self.width} x {self.height}")
        need(1 <= self.views <= 1024, f"views must be 1 to 1024, not {self.views}")
        need(between(self.pitch, 1, 3 * 65536),
             f"pitch must be at least one sub-pixel, not {self.pitch}")
        need(between(self.slant, -1.55, 1.55),
             f"slant must lie between -1.55 and 1.55 radians, not {self.slant}")
        need(math.isfinite(self.offset), f"offset must be a number, not {self.offset}")
        need(self.subpixels in _ORDERS, f"subpixels must be RGB or BGR, not {self.subpixels!r}")
        need(between(self.cone, 1e-3, 170),
             f"cone must lie between 0 and 170 degrees, not {self.cone}")
        need(between(self.distance, 0.1, 1e4),
             f"distance must lie between 0.1 and 10000 half panel heights, not {self.distance}")
        need(between(self.eye_height, -1e4, 1e4),
             f"eye_height must be a number of half panel heights, not {self.eye_height}")
        need(between(self.gamma, 0.2, 5), f"gamma must lie between 0.2 and 5, not {self.gamma}")
        need(between(self.panel_height, 0, 100),
             f"panel_height must lie between 0 and 100 metres, not {self.panel_height}")
        need(len(self.quilt) == len(self.quilt_size) == 2
             and min(self.quilt) >= 1 and max(self.quilt_size) <= 65536
             and all(map(int.__ge__, self.quilt_size, self.quilt)),
             f"quilt must be columns and rows, and quilt_size at least one pixel for each, not "
             f"{list(self.quilt)} and {list(self.quilt_size)}")
        need(self.cell_pattern in CELL_PATTERNS,
             f"cell_pattern must be one of {', '.join(CELL_PATTERNS)}, not {self.cell_pattern!r}")
        need(len(self.cells) <= 4 and all(
            len(cell) == 6 and all(between(value, -2, 2) for value in cell) for cell in self.cells),
             "cells must be up to four rows of six numbers between -2 and 2 (x and y of red, green "
             "and blue)")
        need(not self.cells or (self.subpixels == "RGB" and not (self.flip_x or self.flip_y)),
             "cells give each color's place: subpixels must be RGB and the picture not flipped")

    # -- geometry ---------------------------------------------------------------------------------

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self.width / self.height

    @property
    def shift(self) -> float:
        """Sub-pixels by which the phase grows from one row to the next below: 3 tan(slant)."""
        return 3.0 * math.tan(self.slant)

    def places(self) -> Float64:
        """Where the sub-pixels of a pixel lie, float64 [4, 2, 3, 2].

        For row y mod 4 (rows from the top), column x mod 2 and sub-pixel k: x to the right and y
        downwards from the pixel's upper left corner, in pixels.
        """
        table = np.empty((4, 2, 3, 2))
        if not self.cells:
            table[..., 0] = (np.arange(3) + 0.5) / 3
            table[..., 1] = 0.5
            return table
        up, across = np.ogrid[:4, :2]
        number = {"single": 0 * up + 0 * across, "checkerboard": (up + across) % 2,
                  "rows": up + 0 * across, "staggered": (up + 2 * across) % 4,
                  "columns": 0 * up + across}[self.cell_pattern] % len(self.cells)
        cells = np.asarray(self.cells, np.float64).reshape(-1, 3, 2)[number]
        # The pattern counts rows from the bottom.
        cells = cells[(self.height - 1 - np.arange(4)) % 4]
        table[..., 0] = 0.5 + cells[..., 0]
        table[..., 1] = 0.5 - cells[..., 1]
        return table

    def steps(self) -> Float64:
        """Phase of each sub-pixel against its pixel's, float64 [4, 2, 3]: row mod 4, column mod 2.

        A sub-pixel's phase is 3 x + steps[y % 4, x % 2, k] + y shift + offset, mod L_n.
        """
        if not self.cells:
            return np.broadcast_to(np.arange(3.0), (4, 2, 3)).copy()
        place = self.places() - 0.5
        return 3.0 * place[..., 0] + self.shift * place[..., 1]

    @property
    def breadth(self) -> float:
        """Sub-pixels of a row that one takes up: 3 where a pixel's colors lie in one place."""
        across = self.places()[..., 0]
        return 3.0 if np.ptp(across, axis=-1).max() < 1e-6 else 1.0

    @property
    def alike(self) -> bool:
        """Whether all rows have the same views."""
        return self.shift == 0 and np.ptp(self.steps(), axis=0).max() == 0

    def phase(self, rows: Any, columns: Any, channels: Any) -> Float64:
        """Phase u in [0, L_n), in sub-pixels, of places (row, column, sub-pixel).

        Sub-pixels count from the left, or, where the panel has ``cells``, red, green, blue.
        """
        rows, columns = np.asarray(rows), np.asarray(columns)
        step = self.steps()[rows % 4, columns % 2, channels] if self.cells else channels
        raw = 3.0 * columns.astype(np.float64) + step + rows * self.shift + self.offset
        phase = raw - self.pitch * np.floor(raw / self.pitch)
        phase = np.where(phase >= self.pitch, 0.0, phase)
        return np.where(phase > 0, self.pitch - phase, 0.0) if self.inverted else phase

    def view_of(self, rows: Any, columns: Any, channels: Any) -> Float64:
        """Fractional view v in [0, V_n) of places (row, column, sub-pixel from the left)."""
        view = self.phase(rows, columns, channels) * (self.views / self.pitch)
        return np.minimum(view, np.nextafter(self.views, 0))

    @property
    def eye_reach(self) -> float:
        """X of the cone's right edge at the viewing distance, in half panel heights."""
        return self.distance * math.tan(math.radians(self.cone) / 2)

    def eyes(self) -> Float64:
        """X of each view's eye point, float64 [V_n], in half panel heights."""
        share = 2.0 * (np.arange(self.views) + 0.5) / self.views - 1.0
        return self.eye_reach * share

    def channel(self, place: int) -> int:
        """Color channel (0 red, 1 green, 2 blue) of sub-pixel ``place``."""
        return 2 - place if self.subpixels == "BGR" else place

    def order(self) -> Int64:
        """Color channel of each sub-pixel, int64 [3]."""
        return np.array([self.channel(place) for place in range(3)])

    def to_panel(self, image: Array) -> Array:
        """A picture as seen, [H, W, ...], turned into the one that the panel must be sent.

        The same turns it back; it does nothing to panels that do not mirror.
        """
        image = image[:, ::-1] if self.flip_x else image
        return np.ascontiguousarray(image[::-1] if self.flip_y else image)

    # -- Looking Glass ----------------------------------------------------------------------------

    @staticmethod
    def from_looking_glass(calibration: dict[str, Any], *, views: int = 0, name: str = "",
                           ) -> Display:
        """A display from Looking Glass's calibration: `entries_of_calibration`."""
        return Display(**entries_of_calibration(calibration, views=views, name=name))

    def looking_glass(self, dpi: float = 0.0) -> dict[str, Any]:
        """The panel in Looking Glass's terms: the inverse of `from_looking_glass`.

        Parameters
        ----------
        dpi : Pixels per inch; from the panel's height by default, or 100 where that is not known.

        Returns
        -------
        calibration : Entries as ``visual.json`` has them.
        """
        if self.slant == 0:
            raise UserError("a panel with vertical lenses has no finite Looking Glass slope")
        if dpi <= 0:
            inches = self.panel_height / 0.0254
            dpi = self.height / inches if inches > 0 else 100.0
        lens = 3.0 * self.width / self.pitch
        top, down = (0.5 / self.height, 1.0 / self.height) if self.flip_y else (
            1.0 - 0.5 / self.height, -1.0 / self.height)
        tilt = self.shift / (self.pitch * lens * down)
        phase = (0.5 / self.width + top * tilt) * lens
        slope = self.height / (self.width * tilt) * (-1 if self.flip_x else 1)
        values: dict[str, float] = {
            "pitch": lens * dpi / self.width / math.cos(math.atan(1.0 / slope)), "slope": slope,
            "center": (phase - self.offset / self.pitch) % 1.0, "viewCone": self.cone,
            "invView": float(self.inverted), "verticalAngle": 0.0, "DPI": dpi,
            "screenW": float(self.width), "screenH": float(self.height),
            "flipImageX": float(self.flip_x), "flipImageY": float(self.flip_y),
            "flipSubp": float(self.subpixels == "BGR")}
        calibration: dict[str, Any] = {key: {"value": value} for key, value in values.items()}
        calibration["serial"] = self.name
        if self.cells:
            calibration["CellPatternMode"] = {
                "value": float(CELL_PATTERNS.index(self.cell_pattern))}
            calibration["subpixelCells"] = [dict(zip(_CELL, cell)) for cell in self.cells]
        return calibration

    # -- files ------------------------------------------------------------------------------------

    @staticmethod
    def names() -> list[str]:
        """Names of the presets."""
        folder = resources.files("lfportrait.lightfield") / "presets"
        return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml"))

    @staticmethod
    def preset(name: str) -> Display:
        """A preset by its name.

        Raises
        ------
        UserError : If there is none of this name; the message lists them.
        """
        if name not in Display.names():
            raise UserError(f"there is no display {name!r}; the presets are "
                            f"{', '.join(Display.names())}; or name a display file")
        folder = resources.files("lfportrait.lightfield") / "presets"
        text = (folder / f"{name}.toml").read_text("utf-8")
        return Display(**entries_of(text, name))

    @staticmethod
    def load(path: str | Path) -> Display:
        """Read a display file (TOML) or a Looking Glass calibration (``visual.json``).

        Raises
        ------
        UserError : If the file is missing or does not describe a display.
        """
        path = Path(path)
        if path.suffix.lower() != ".json":
            try:
                text = path.read_text(encoding="utf-8")
            except (OSError, UnicodeDecodeError) as error:
                raise UserError(f"can't read the display file {path}: {error}") from error
            return Display(**entries_of(text, path.stem))
        data = read_json(path)
        if isinstance(data, dict):
            data = data.get("calibration", data)
        if not isinstance(data, dict):
            raise UserError(f"{path} is not a calibration file")
        return Display.from_looking_glass(data)

    @staticmethod
    def resolve(name: str | Path) -> Display:
        """A preset's name, or a file's."""
        if str(name) not in Display.names() and os.path.isfile(name):
            return Display.load(name)
        return Display.preset(str(name))

    def to_toml(self) -> str:
        """The display as a TOML text that `load` reads and a person can edit."""
        lines = []
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, tuple):
                value = [list(row) if isinstance(row, tuple) else row for row in value]
            # JSON writes these as TOML does.
            text = json.dumps(value)
            note = (f"  # radians; {math.degrees(value):.4f} degrees" if entry.name == "slant"
                    else "")
            lines.append(f"{entry.name} = {text}{note}")
        return "\n".join(lines) + "\n"

    def save(self, path: str | Path) -> None:
        """Write the display as TOML."""
        with atomic_write(path) as stream:
            stream.write(self.to_toml().encode())

    def summary(self) -> str:
        """One line for people."""
        marks = [] if self.calibrated else ["uncalibrated"]
        marks += [self.note] if self.note else []
        return (f"{self.name:<26} {self.width} x {self.height}, {self.views} views, pitch "
                f"{self.pitch:.4f} sub-pixels, slant {math.degrees(self.slant):.3f} degrees, cone "
                f"{self.cone:g} degrees{'  (' + '; '.join(marks) + ')' if marks else ''}")

    def hash(self) -> str:
        """Hash of all parameters of the view mapping, 24 hex digits."""
        numbers = [float(number).hex() for number in (self.pitch, self.slant, self.offset)]
        key = [self.width, self.height, self.views, *numbers, self.subpixels, self.inverted]
        if self.cells:
            key += [self.cell_pattern, [[float(value).hex() for value in cell]
                                        for cell in self.cells]]
        return hashlib.sha256(json.dumps(key).encode()).hexdigest()[:24]

    def scaled(self, width: int, height: int) -> Display:
        """The same lenses on a panel of another size in pixels."""
        return replace(self, width=width, height=height)


# -- coded pictures in files -----------------------------------------------------------------------


def check_size(image: UInt8, display: Display) -> None:
    """Raise `UserError` if a picture does not have the panel's size."""
    if image.shape[:2] != (display.height, display.width):
        raise UserError(f"the picture is {image.shape[1]} x {image.shape[0]} pixels, but the "
                        f"display {display.name} has {display.width} x {display.height}: a coded "
                        "picture must not be scaled")


def lossless(path: str | Path) -> Path:
    """The path, if its format keeps every sub-pixel."""
    path = Path(path)
    if path.suffix.lower() not in (".png", ".tif", ".tiff", ".bmp"):
        raise UserError("a coded picture must keep every sub-pixel: write it as .png, not "
                        f"{path.suffix or 'without a suffix'}")
    return path


def read_coded(path: str | Path, display: Display) -> UInt8:
    """A coded picture as the viewer sees the panel, uint8 [H, W, 3]."""
    image = np.ascontiguousarray(read_image(path)[..., :3])
    check_size(image, display)
    return display.to_panel(image)


def write_coded(path: str | Path, image: UInt8, display: Display) -> None:
    """Write a coded picture, uint8 [H, W, 3] as seen, so that the panel shows it right."""
    check_size(image, display)
    write_image(lossless(path), display.to_panel(image), fast=True)
