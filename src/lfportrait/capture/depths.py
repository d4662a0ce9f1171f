"""Depth maps beside a capture's pictures: straightened with them, saved and read again."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..arrays import Float32
from ..files import UNREADABLE_ARRAYS
from ..media.depth import DepthMap
from .distortion import Lens

__all__ = ["load_depth", "save_depth", "some_depth", "straightened"]

_TOLD = ("kind", "metric", "along", "near", "far", "source")


def some_depth(depths: Sequence[DepthMap | None]) -> list[DepthMap | None] | None:
    """The depth maps of views, or None where no view has one."""
    return list(depths) if any(depth is not None for depth in depths) else None


def straightened(depth: DepthMap, lens: Lens) -> DepthMap:
    """A depth map as it lies over the picture that `undistort` makes of its photo.

    The numbers are moved alone: z along the axis and the distance along the ray are of a point, not
    of the lens. Between pixels they are blended from those that are known; unknown is what lies
    nearer to an unknown one, or outside the photo.

    Parameters
    ----------
    depth
        Over the upright photo.
    lens
        The photo's lens.
    """
    if not lens.distorts:
        return depth
    height, width = depth.values.shape
    place = lens.source_pixels((width, height))
    outside = ~((place >= 0) & (place <= (lens.width, lens.height))).all(-1)
    place = np.nan_to_num(place * (width / lens.width, height / lens.height), nan=-1.0) - 0.5
    columns = np.ascontiguousarray(place[..., 0], np.float32)
    rows = np.ascontiguousarray(place[..., 1], np.float32)

    def moved(numbers: Float32) -> Float32:
        return np.asarray(cv2.remap(np.ascontiguousarray(numbers), columns, rows,
                                    cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))

    known = np.isfinite(depth.values).astype(np.float32)
    weight = moved(known)
    values = moved(np.where(known > 0, depth.values, np.float32(0.0)))
    values = np.where((weight >= 0.5) & ~outside, values / np.maximum(weight, np.float32(1e-6)),
                      np.float32(np.nan))
    confidence = None
    if depth.confidence is not None:
        confidence = np.where(outside, np.float32(0.0), moved(depth.confidence))
    return replace(depth, values=np.asarray(values, np.float32), confidence=confidence)


def save_depth(folder: Path, name: str, depth: DepthMap) -> dict[str, Any]:
    """Write a map's arrays to ``folder/name`` (.npz); the entry for ``transforms.json``."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {"values": depth.values}
    if depth.confidence is not None:
        arrays["confidence"] = depth.confidence
    np.savez_compressed(path, **arrays)
    return {"file_path": name} | {key: getattr(depth, key) for key in _TOLD}


def load_depth(folder: Path, entry: Any) -> DepthMap | None:
    """The map of an entry that `save_depth` made; a damaged one is left out with a warning."""
    if entry is None:
        return None
    try:
        with np.load(folder / entry["file_path"], allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name], np.float32) for name in file.files}
        return DepthMap(arrays["values"], confidence=arrays.get("confidence"),
                        **{key: entry[key] for key in _TOLD})
    except UNREADABLE_ARRAYS as error:
        warnings.warn(f"a depth map in {folder} can't be read and is left out: {error}",
                      stacklevel=2)
        return None
