"""A lenticular display: which view each sub-pixel belongs to, and from where that view is seen.

Display frame: origin at the panel's centre, x right, y up, z to the viewer; the unit is half the
panel's height. Sub-pixel k of column x and row y (rows from the top) has the phase under its lens,
in sub-pixels, and the view (Shen et al. 2023, Eq. 8, written for columns from the left)::

    u = (3 x + k + 3 y tan(slant) + offset) mod L_n,     v = u V_n / L_n  in [0, V_n)

The paper's value is v - V_n / 2 of the mirrored column. Looking Glass states the same by ``pitch``,
``slope`` and ``center`` over the panel from its lower left corner; `from_looking_glass` and
`looking_glass` convert exactly.

View v is seen from the point (x_v, eye_height, distance) on a horizontal line, with
x_v = distance tan(cone / 2) (2 (v + 1/2) / V_n - 1): view 0 is the leftmost.
"""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from dataclasses import dataclass, fields, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from ..files import atomic_write

__all__ = ["Display"]

_ORDERS = ("RGB", "BGR")


@dataclass(frozen=True)
class Display:
    """A lenticular panel.

    Attributes
    ----------
    width, height
        Panel size in pixels.
    views
        V_n, number of views.
    pitch
        L_n, sub-pixels under one lens along a row (may be fractional).
    slant
        Angle of the lenses against the vertical in radians; positive shifts the phase to the right
        row by row, by 3 tan(slant) sub-pixels.
    offset
        Phase of the top left sub-pixel, in sub-pixels.
    subpixels
        Order of the colours from left to right, ``"RGB"`` or ``"BGR"``.
    cone
        Angle in degrees between the outermost views.
    distance
        Viewing distance in half panel heights.
    eye_height
        Height of the eyes above the panel's centre, in half panel heights.
    inverted
        True where the phase grows from the right to the left view.
    panel_height
        Height of the panel in metres; 0 = unknown.
    quilt
        Columns and rows of the customary quilt.
    quilt_size
        Width and height of the customary quilt in pixels.
    name, note
        For people.
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
    panel_height: float = 0.0
    quilt: tuple[int, int] = (8, 6)
    quilt_size: tuple[int, int] = (3360, 3360)
    name: str = "display"
    note: str = ""

    def __post_init__(self) -> None:
        def need(good: bool, text: str) -> None:
            if not good:
                raise UserError(f"display {self.name!r}: {text}")

        need(1 <= self.width <= 65536 and 1 <= self.height <= 65536,
             f"width and height must be 1 to 65536 pixels, not {self.width} x {self.height}")
        need(1 <= self.views <= 1024, f"views must be 1 to 1024, not {self.views}")
        need(math.isfinite(self.pitch) and self.pitch >= 1,
             f"pitch must be at least one sub-pixel, not {self.pitch}")
        need(math.isfinite(self.slant) and abs(self.slant) < 1.55,
             f"slant must lie between -1.55 and 1.55 radians, not {self.slant}")
        need(math.isfinite(self.offset), f"offset must be a number, not {self.offset}")
        need(self.subpixels in _ORDERS, f"subpixels must be RGB or BGR, not {self.subpixels!r}")
        need(0 < self.cone < 170, f"cone must lie between 0 and 170 degrees, not {self.cone}")
        need(math.isfinite(self.distance) and self.distance > 0.1,
             f"distance must be above 0.1 half panel heights, not {self.distance}")
        need(min(*self.quilt, *self.quilt_size) >= 1, "quilt needs at least one tile and pixel")

    # -- geometry ---------------------------------------------------------------------------------

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self.width / self.height

    @property
    def shift(self) -> float:
        """Sub-pixels by which the phase grows from one row to the next below: 3 tan(slant)."""
        return 3.0 * math.tan(self.slant)

    def phase(self, rows: Any, columns: Any, channels: Any) -> NDArray[np.float64]:
        """Phase u in [0, L_n), in sub-pixels, of places (row, column, sub-pixel from the left)."""
        running = 3.0 * np.asarray(columns, np.float64) + channels
        raw = running + np.asarray(rows, np.float64) * self.shift + self.offset
        phase = raw - self.pitch * np.floor(raw / self.pitch)
        phase = np.where(phase >= self.pitch, 0.0, phase)
        return np.where(phase > 0, self.pitch - phase, 0.0) if self.inverted else phase

    def view_of(self, rows: Any, columns: Any, channels: Any) -> NDArray[np.float64]:
        """Fractional view v in [0, V_n) of places (row, column, sub-pixel from the left)."""
        view = self.phase(rows, columns, channels) * (self.views / self.pitch)
        return np.minimum(view, np.nextafter(self.views, 0))

    def eyes(self) -> NDArray[np.float64]:
        """X of each view's eye point, float64 [V_n], in half panel heights."""
        share = 2.0 * (np.arange(self.views) + 0.5) / self.views - 1.0
        return self.distance * math.tan(math.radians(self.cone) / 2) * share

    def view_at(self, x: float) -> float:
        """Fractional view that an eye at ``x`` on the eye line receives (v + 1/2 in the middle)."""
        share = x / (self.distance * math.tan(math.radians(self.cone) / 2))
        return 0.5 * (share + 1.0) * self.views

    # -- Looking Glass ----------------------------------------------------------------------------

    @staticmethod
    def from_looking_glass(calibration: dict[str, Any], *, views: int = 0, name: str = "",
                           ) -> Display:
        """A display from Looking Glass's calibration (the contents of ``visual.json``).

        With s, t in [0, 1] over the panel from its lower left, the vendor's shader computes
        a = fract((s + t tilt + k / (3 screenW)) pitch' - center), view = floor(a views), where
        pitch' = pitch (screenW / DPI) cos(atan(1 / slope)) and tilt = screenH / (screenW slope).
        """
        def value(key: str, default: float | None = None) -> float:
            entry = calibration.get(key, default)
            if isinstance(entry, dict):
                entry = entry.get("value", default)
            if entry is None:
                raise UserError(f"the calibration lacks {key!r}")
            try:
                return float(entry)
            except (TypeError, ValueError) as error:
                raise UserError(f"the calibration's {key!r} is no number: {entry!r}") from error

        width, height = round(value("screenW")), round(value("screenH"))
        slope, dpi = value("slope"), value("DPI")
        if slope == 0 or dpi <= 0:
            raise UserError("the calibration's slope and DPI must not be 0")
        if value("flipImageX", 0) or value("flipImageY", 0):
            raise UserError("the calibration mirrors the picture (flipImageX or flipImageY), which "
                            "is not supported")
        lens = value("pitch") * (width / dpi) * math.cos(math.atan(1.0 / slope))
        tilt = height / (width * slope)
        pitch = 3.0 * width / lens
        # t falls by 1 / H from row to row; the top row's pixel centres lie at t = 1 - 1 / (2 H).
        shift = -tilt * pitch * lens / height
        phase = (0.5 / width + (1.0 - 0.5 / height) * tilt) * lens - value("center")
        size = {1536: (8, 6, 3360, 3360), 1440: (11, 6, 4092, 4092)}.get(
            width, (5, 9, 4096, 4096))
        return Display(
            width, height, views or size[0] * size[1], abs(pitch), math.atan(shift / 3.0),
            phase * abs(pitch) % abs(pitch), "BGR" if value("flipSubp", 0) else "RGB",
            value("viewCone", 40.0), 4.0, inverted=bool(value("invView", 0)) != (pitch < 0),
            panel_height=height / dpi * 0.0254, quilt=(size[0], size[1]),
            quilt_size=(size[2], size[3]),
            name=name or str(calibration.get("serial", {}) if not isinstance(
                calibration.get("serial"), dict) else calibration["serial"].get("value", "")
            ) or "looking-glass")

    def looking_glass(self, dpi: float = 100.0) -> dict[str, Any]:
        """The panel in Looking Glass's terms (the inverse of `from_looking_glass`)."""
        if self.slant == 0:
            raise UserError("a panel with vertical lenses has no finite Looking Glass slope")
        lens = 3.0 * self.width / self.pitch
        tilt = -self.shift / self.pitch * self.height / lens
        slope = self.height / (self.width * tilt)
        phase = (0.5 / self.width + (1.0 - 0.5 / self.height) * tilt) * lens
        values = {"pitch": lens * dpi / self.width / math.cos(math.atan(1.0 / slope)),
                  "slope": slope, "center": (phase - self.offset / self.pitch) % 1.0,
                  "viewCone": self.cone, "invView": float(self.inverted), "DPI": dpi,
                  "screenW": float(self.width), "screenH": float(self.height), "flipImageX": 0.0,
                  "flipImageY": 0.0, "flipSubp": float(self.subpixels == "BGR")}
        return {key: {"value": value} for key, value in values.items()}

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
        UserError
            If there is none of this name; the message lists them.
        """
        if name not in Display.names():
            raise UserError(f"there is no display {name!r}; the presets are "
                            f"{', '.join(Display.names())}; or name a display file")
        folder = resources.files("lfportrait.lightfield") / "presets"
        return _from_toml((folder / f"{name}.toml").read_text(), name)

    @staticmethod
    def load(path: str | Path) -> Display:
        """Read a display file (TOML) or a Looking Glass calibration (``visual.json``).

        Raises
        ------
        UserError
            If the file is missing or does not describe a display.
        """
        path = Path(path)
        try:
            text = path.read_text()
        except (OSError, UnicodeDecodeError) as error:
            raise UserError(f"can't read the display file {path}: {error}") from error
        if path.suffix.lower() == ".json":
            try:
                data = json.loads(text)
            except ValueError as error:
                raise UserError(f"{path} is not valid JSON: {error}") from error
            if not isinstance(data, dict):
                raise UserError(f"{path} is no calibration file")
            return Display.from_looking_glass(data.get("calibration", data))
        return _from_toml(text, path.stem)

    @staticmethod
    def resolve(name: str | Path) -> Display:
        """A preset's name, or a file's."""
        if str(name) not in Display.names() and Path(name).is_file():
            return Display.load(name)
        return Display.preset(str(name))

    def to_toml(self) -> str:
        """The display as a TOML text that `load` reads and a person can edit."""
        lines = []
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, bool):
                text = str(value).lower()
            elif isinstance(value, str):
                text = json.dumps(value)
            elif isinstance(value, tuple):
                text = str(list(value))
            else:
                text = repr(value)
            note = ""
            if entry.name == "slant":
                note = f"  # radians; {math.degrees(value):.4f} degrees"
            lines.append(f"{entry.name} = {text}{note}")
        return "\n".join(lines) + "\n"

    def save(self, path: str | Path) -> None:
        """Write the display as TOML."""
        with atomic_write(path) as stream:
            stream.write(self.to_toml().encode())

    def summary(self) -> str:
        """One line for people."""
        return (f"{self.name:<22} {self.width} x {self.height}, {self.views} views, pitch "
                f"{self.pitch:.4f} sub-pixels, slant {math.degrees(self.slant):.3f} degrees, cone "
                f"{self.cone:g} degrees{'  (' + self.note + ')' if self.note else ''}")

    def hash(self) -> str:
        """Hash of all that decides which view a sub-pixel shows, 24 hex digits."""
        key = [self.width, self.height, self.views, self.pitch.hex(), self.slant.hex(),
               self.offset.hex(), self.subpixels, self.inverted]
        return hashlib.sha256(json.dumps(key).encode()).hexdigest()[:24]

    def scaled(self, width: int, height: int) -> Display:
        """The same lenses on a panel of another size in pixels."""
        return replace(self, width=width, height=height)


def _from_toml(text: str, name: str) -> Display:
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"the display file {name} is not valid TOML: {error}") from error
    data.setdefault("name", name)
    if "slant_degrees" in data:
        data["slant"] = math.radians(float(data.pop("slant_degrees")))
    known = {entry.name: entry for entry in fields(Display)}
    unknown = sorted(set(data) - set(known))
    if unknown:
        raise UserError(f"the display file {name} has unknown entries: {', '.join(unknown)}")
    missing = [key for key in ("width", "height", "views", "pitch") if key not in data]
    if missing:
        raise UserError(f"the display file {name} lacks {', '.join(missing)}")
    for key in ("quilt", "quilt_size"):
        if key in data:
            data[key] = tuple(data[key])
    for key, entry in known.items():
        kinds: dict[str, Any] = {"int": int, "float": (int, float), "str": str, "bool": bool}
        kind = kinds.get(str(entry.type))
        wrong = key in data and kind is not None and (
            not isinstance(data[key], kind) or (isinstance(data[key], bool) and kind is not bool))
        if wrong:
            raise UserError(f"the display file {name}: {key} = {data[key]!r} is not "
                            f"{'a number' if kind is not str else 'a text'}")
        if key in data and str(entry.type) == "float":
            data[key] = float(data[key])
    return Display(**data)
