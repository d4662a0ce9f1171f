"""What goes with a quilt besides its pixels: the side file, and the older block in its EXIF.

Looking Glass's programs look for a quilt's layout in its name, in ``NAME.png.json`` beside it, or,
the older ones, in a JSON text in the EXIF tag UserComment.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from PIL import Image

from ...errors import UserError
from ...files import read_json
from ...lightfield import QuiltLayout
from ...media.pictures import open_picture

__all__ = ["SECONDS", "layout_of_file", "quilt_exif", "quilt_settings"]

SECONDS = 20.0
"""How long a frame shows a picture."""
_EXIF, _USER_COMMENT = 0x8769, 0x9286
_ASCII = b"ASCII\0\0\0"


def quilt_settings(layout: QuiltLayout, *, movie: bool = False, seconds: float = SECONDS,
                   ) -> dict[str, Any]:
    """Contents of a quilt's side file: the settings of Looking Glass Studio."""
    return {
        "movie": movie, "mediaType": "quilt",
        "quilt_settings": {"viewX": layout.columns, "viewY": layout.rows,
                           "viewTotal": layout.count, "invertViews": False,
                           "aspect": round(layout.aspect, 6)},
        "depthiness": 1.0, "depthInversion": False, "chromaDepth": False,
        "depthPosition": "right", "focus": 0.0, "viewOrderReversed": False, "zoom": 1.0,
        "position_x": 0.0, "position_y": 0.0, "duration": seconds}


def quilt_exif(layout: QuiltLayout) -> Image.Exif:
    """The older block, to be saved with a PNG, JPEG or WebP file."""
    text = json.dumps({"LKGNumViews": layout.count, "LKGRows": layout.rows,
                       "LKGColumns": layout.columns, "LKGAspect": round(layout.aspect, 6),
                       "LKGType": "quilt"})
    exif = Image.Exif()
    exif.get_ifd(_EXIF)[_USER_COMMENT] = _ASCII + text.encode()
    return exif


def _of_side_file(path: Path) -> QuiltLayout | None:
    side = path.with_name(path.name + ".json")
    if not side.is_file():
        return None
    try:
        entry = read_json(side)["quilt_settings"]
        return _layout(entry["viewX"], entry["viewY"], entry["aspect"])
    except (KeyError, TypeError, ValueError, UserError):
        return None


def _of_exif(path: Path) -> QuiltLayout | None:
    try:
        with open_picture(path) as picture:
            comment = picture.getexif().get_ifd(_EXIF).get(_USER_COMMENT, b"")
        text = comment.encode() if isinstance(comment, str) else bytes(comment)
        entry = json.loads(text[text.find(b"{"):].rstrip(b"\0 "))
        return _layout(entry["LKGColumns"], entry["LKGRows"], entry["LKGAspect"])
    except (OSError, KeyError, TypeError, ValueError, SyntaxError):
        return None


def _layout(columns: Any, rows: Any, aspect: Any) -> QuiltLayout:
    layout = QuiltLayout(int(columns), int(rows), float(aspect))
    if layout.columns < 1 or layout.rows < 1 or not 0 < layout.aspect < 1e4:
        raise ValueError("an impossible layout")
    return layout


def layout_of_file(path: Path) -> QuiltLayout | None:
    """The layout of a quilt by its name, its side file or its EXIF, in this order; else None."""
    return QuiltLayout.of_name(path.name) or _of_side_file(path) or _of_exif(path)
