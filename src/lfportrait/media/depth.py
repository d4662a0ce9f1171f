"""Depth that phones keep in the pictures of their portrait mode.

HEIC of iPhones (`depth_heic`); JPEG with GDepth, Dynamic Depth or, of iPhones, a second picture
(`depth_jpeg`). What the numbers mean, `depth_xmp` says.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path

from .depth_heic import heic_depth, is_heic
from .depth_jpeg import is_jpeg, jpeg_depth
from .depth_map import DepthMap

__all__ = ["DepthMap", "read_depth"]


def read_depth(path: str | os.PathLike[str]) -> DepthMap | None:
    """The depth of a picture, upright as `files.read_image` reads the picture; None without any.

    A file is known by its content, not by its name. The picture is not decoded; a JPEG without
    depth is read up to its first scan. Depth that is damaged is left out with a warning: the
    picture is worth more. A missing file has none.
    """
    path = Path(path)
    try:
        with open(path, "rb") as stream:
            start = stream.read(12)
        if is_jpeg(start):
            return jpeg_depth(path)
        return heic_depth(path) if is_heic(start) else None
    except FileNotFoundError:
        return None
    except Exception as error:  # whatever a decoder raises, the picture may still be read
        warnings.warn(f"the depth in {path.name} can't be read and is left out: {_line(error)}",
                      stacklevel=2)
        return None


def _line(error: Exception) -> str:
    text = str(error).strip()
    return text.splitlines()[0] if text else type(error).__name__
