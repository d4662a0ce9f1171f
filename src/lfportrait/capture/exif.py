"""EXIF data of a photo: focal length, lens, orientation.

The focal length in pixels follows, in this order, from

1. the focal length of an equal lens on 35-mm film (phones and most cameras),
2. the focal length and the pixels to an inch or a centimetre of the sensor,
3. the focal length and the width of the sensor, which COLMAP's table of cameras knows for some
   thousand models (pycolmap).

A picture that was cropped or stitched later still has the sensor's EXIF data; so it is only an
initial value.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from ..temporary import temporary_folder

__all__ = ["Noted", "noted"]

_MAKE, _MODEL, _ORIENTATION, _IFD = 0x010F, 0x0110, 0x0112, 0x8769
_FOCAL, _FOCAL_35MM, _LENS = 0x920A, 0xA405, 0xA434
_PLANE_X, _PLANE_Y, _PLANE_UNIT, _PIXELS_X, _PIXELS_Y = 0xA20E, 0xA20F, 0xA210, 0xA002, 0xA003
# Millimetres of a unit of the focal plane's resolution.
_UNITS = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
# Quarter turns counter-clockwise from the upright picture to the sensor's, by EXIF's orientation.
_TURNS = {6: 1, 3: 2, 8: 3}
# Longer side of a sensor in millimetres: from the smallest phone's to large format. A note that
# leads outside is wrong.
_SENSORS = (2.0, 150.0)
_FILM = 36.0


@dataclass(frozen=True)
class Noted:
    """EXIF data of one picture.

    Attributes
    ----------
    focal
        Focal length over the picture's longer side; None where nothing usable is noted.
    source
        Where it is from: ``"35 mm"``, ``"focal plane"``, ``"camera model"``; or empty.
    lens
        Camera, lens and focal length in millimetres: equal for photos of one lens, not zoomed.
    turns
        Quarter turns (counter-clockwise) from the upright picture to the sensor's, 0 to 3.
    """

    focal: float | None = None
    source: str = ""
    lens: str = ""
    turns: int = 0


def _number(value: Any) -> float:
    """A positive number that a tag holds, else 0."""
    with contextlib.suppress(TypeError, ValueError, ZeroDivisionError):
        number = float(value)
        return number if math.isfinite(number) and number > 0 else 0.0
    return 0.0


def _text(value: Any) -> str:
    return str(value).strip(" \0") if isinstance(value, str) else ""


def _by_plane(tags: Any, length: float, side: int) -> float:
    """Focal length over the longer side by the focal plane's resolution, or 0.

    The resolution is that of the picture as it was taken (``PixelXDimension``); a reduced copy
    keeps both tags.
    """
    unit = _UNITS.get(int(_number(tags.get(_PLANE_UNIT))) or 2, 0.0)
    density = _number(tags.get(_PLANE_X)) or _number(tags.get(_PLANE_Y))
    taken = max(_number(tags.get(_PIXELS_X)), _number(tags.get(_PIXELS_Y))) or float(side)
    if not (unit and density and length):
        return 0.0
    sensor = taken / density * unit
    return length / sensor if _SENSORS[0] < sensor < _SENSORS[1] else 0.0


def _by_model(make: str, model: str, length: float, size: tuple[int, int]) -> float:
    """Focal length over the longer side by COLMAP's table of sensors, or 0.

    COLMAP reads it from a file; one of a few hundred bytes does.
    """
    if not (make and model and length):
        return 0.0
    try:
        import pycolmap
    except ImportError:
        return 0.0
    pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
    exif = Image.Exif()
    exif[_MAKE], exif[_MODEL] = make, model
    exif.get_ifd(_IFD)[_FOCAL] = IFDRational(round(1000 * length), 1000)
    shape = (36, 24) if size[0] >= size[1] else (24, 36)
    with temporary_folder(4096) as folder:
        path = Path(folder) / "note.jpg"
        Image.new("L", shape).save(path, exif=exif)
        found = pycolmap.Bitmap.read(path, True)
        focal = None if found is None else found.exif_focal_length()
    return 0.0 if not focal else float(focal) / max(shape)


_MODELS: dict[tuple[str, str, float], float] = {}
"""Found by `_by_model`: photos of one set repeat themselves."""


def noted(exif: Image.Exif, size: tuple[int, int]) -> Noted:
    """Read the EXIF data of a picture.

    Parameters
    ----------
    exif
        Of a picture as Pillow reads it.
    size
        Width and height of the picture in pixels.

    Returns
    -------
    notes
        What is noted and makes sense; damaged tags count as missing.
    """
    try:
        tags: Any = exif.get_ifd(_IFD)
    except (KeyError, TypeError, ValueError, SyntaxError, OSError):
        tags = {}
    make, model = _text(exif.get(_MAKE)), _text(exif.get(_MODEL))
    length, film = _number(tags.get(_FOCAL)), _number(tags.get(_FOCAL_35MM))
    focal, source = film / _FILM, "35 mm"
    if not focal:
        focal, source = _by_plane(tags, length, max(size)), "focal plane"
    if not focal and length:
        key = make, model, length
        if key not in _MODELS:
            _MODELS[key] = _by_model(make, model, length, size)
        focal, source = _MODELS[key], "camera model"
    if not 0.2 < focal < 50:
        focal, source = 0.0, ""
    # The orientation is a whole number wherever it is anything.
    turns = _TURNS.get(int(_number(exif.get(_ORIENTATION))), 0)
    lens = " ".join(part for part in (make, model, _text(tags.get(_LENS)),
                                      f"{length:.4g} mm" if length else "",
                                      f"({film:.4g} mm)" if film else "") if part)
    return Noted(focal or None, source, lens, turns)
