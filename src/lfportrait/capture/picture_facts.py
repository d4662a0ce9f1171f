"""What is known of a picture's file before it is decoded: how `read_photos` will read it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..media.colors import named_colors
from ..media.depth import DepthMap, read_depth
from ..media.pictures import fault_of, file_of, open_header, orientation_of, sizes_of
from .photos import Noted, noted

__all__ = ["DepthFacts", "PictureFacts", "picture_facts"]

_ERRORS = (OSError, ValueError, SyntaxError, RuntimeError, MemoryError)


@dataclass(frozen=True)
class DepthFacts:
    """Of the depth that a picture's file keeps.

    Attributes
    ----------
    source
        As in `DepthMap`.
    size
        Width and height of the map, upright.
    nearest, farthest
        Range of its distances, in metres or in no known unit; None where none is known.
    metric
        Whether they are metres.
    confidence
        Whether the file says how sure each distance is.
    """

    source: str
    size: tuple[int, int]
    nearest: float | None
    farthest: float | None
    metric: bool
    confidence: bool

    @staticmethod
    def of(depth: DepthMap) -> DepthFacts:
        """The facts of a map."""
        distances, metric = depth.distance()
        known = distances[np.isfinite(distances)]
        near, far = (float(known.min()), float(known.max())) if known.size else (None, None)
        return DepthFacts(depth.source, (depth.values.shape[1], depth.values.shape[0]), near, far,
                          metric, depth.confidence is not None)


@dataclass(frozen=True)
class PictureFacts:
    """Of one picture's file.

    Attributes
    ----------
    path
        The file.
    fault
        Why it can't be read, in one line; empty where it can. Nothing else is known then.
    format
        As Pillow names it: ``"JPEG"``, ``"HEIF"``, ...
    mode
        Pillow's mode: ``"RGB"``, ``"RGBA"``, ``"CMYK"``, ``"I;16"``, ...
    stored, upright
        Width and height in pixels, in the file and as it is read.
    orientation
        As noted, 1 to 8 as in EXIF.
    colors, colors_by
        The color space that its numbers are read by, and what says so (empty: nothing does).
    noted
        Lens and focal length by its EXIF data.
    depth
        Of its depth, or None.
    """

    path: Path
    fault: str = ""
    format: str = ""
    mode: str = ""
    stored: tuple[int, int] = (0, 0)
    upright: tuple[int, int] = (0, 0)
    orientation: int = 1
    colors: str = ""
    colors_by: str = ""
    noted: Noted = field(default_factory=Noted)
    depth: DepthFacts | None = None


def picture_facts(path: Path) -> PictureFacts:
    """Look at a picture's file; whatever is wrong with it is its ``fault``."""
    fault = fault_of(path)
    if fault:
        return PictureFacts(path, fault)
    try:
        with open_header(path) as picture:
            colors, colors_by = named_colors(picture, file_of(picture))
            stored, upright = sizes_of(picture)
            found = PictureFacts(
                path, format=picture.format or "", mode=picture.mode, stored=stored,
                upright=upright, orientation=orientation_of(picture), colors=colors,
                colors_by=colors_by, noted=noted(picture.getexif(), picture.size))
    except _ERRORS as error:
        return PictureFacts(path, str(error).splitlines()[0] if str(error)
                            else type(error).__name__)
    depth = read_depth(path)
    return found if depth is None else replace(found, depth=DepthFacts.of(depth))
