"""Display files: TOML that a person can write, and Looking Glass's ``visual.json``."""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..files import read_json
from . import lookingglass

__all__ = ["entries_of", "load_entries", "text_of"]

_REQUIRED = ("width", "height", "views", "pitch")
_PAIRS = ("quilt", "quilt_size")


def load_entries(path: Path, kinds: dict[str, str]) -> dict[str, Any]:
    """Read a display file, or a calibration where the name ends in ``.json``.

    Parameters
    ----------
    path
        The file.
    kinds
        Names and types of a display's entries.

    Returns
    -------
    entries
        Arguments of `Display`.

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
    return lookingglass.entries_of(data)


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
