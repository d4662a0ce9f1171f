"""What goes with a quilt besides its pixels: the side file, and the older block in its EXIF.

Looking Glass's programs look for a quilt's layout in its name, in ``NAME.png.json`` beside it, or,
the older ones, in a JSON text in the EXIF tag UserComment. (`lfportrait.lightfield.layout_of_file`
reads all of them.)
"""

from __future__ import annotations

import json
from typing import Any

from PIL import Image

from ...lightfield import QuiltLayout

__all__ = ["SECONDS", "quilt_block", "quilt_exif", "quilt_settings"]

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


def quilt_block(layout: QuiltLayout) -> str:
    """The older block, a JSON text."""
    return json.dumps({"LKGNumViews": layout.count, "LKGRows": layout.rows,
                       "LKGColumns": layout.columns, "LKGAspect": round(layout.aspect, 6),
                       "LKGType": "quilt"})


def quilt_exif(layout: QuiltLayout) -> Image.Exif:
    """The older block, to be saved with a PNG, JPEG or WebP file."""
    exif = Image.Exif()
    exif.get_ifd(_EXIF)[_USER_COMMENT] = _ASCII + quilt_block(layout).encode()
    return exif
