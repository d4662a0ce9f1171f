"""Files of expensive results: a skin beside its field, and the materials of paintings.

A skin's file knows what it was made of: it is used for that field and those landmarks alone. The
rest is computed when it is read. What a painting is made of is kept in the user's cache, as its
regions are: it takes a tenth of a preview in a new process, and depends on the painting alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cache import key_of
from ...capture import Camera
from ...files import UNREADABLE_ARRAYS, atomic_write, map_arrays, write_mappable
from ..surface_guide import HeadPlane
from .charts import Atlas, Shape
from .sitter import Skin

__all__ = ["load_skin", "save_skin", "skin_key"]

_LISTS = ("index", "flat", "tone", "detail", "appearance", "contours", "hair", "clothes", "ears",
          "seen", "outwards", "rows")
_OURS = (*_LISTS, "key", "pixels", "landmarks", "boxes", "depth", "color", "owner",
         "shape_normals", "shape_low", "shape_cell", "labels", "regions",
         "pose", "focal", "center", "width", "height")


def skin_key(*made_of: Any) -> str:
    """What a skin depends on, as a short text."""
    return key_of("example.skin.sitter", *made_of)


def save_skin(skin: Skin, path: Path, key: str, **more: NDArray[Any]) -> None:
    """Write a skin, the key of what it was made of, and ``more`` that others keep with it."""
    atlas = skin.atlas
    cameras = atlas.cameras
    labels, regions = skin.labels
    lists: dict[str, NDArray[Any]] = {}
    for name in _LISTS:
        value = getattr(skin, name)
        if value is not None:
            # Shares and tones have no more than a thousand steps.
            lists[name] = (value.astype(np.float16) if value.dtype == np.float32
                           and name not in ("flat", "rows") else value)
    with atomic_write(path) as stream:
        write_mappable(stream, {
            "key": np.str_(key), "pixels": np.float64(skin.pixels),
            "landmarks": skin.plane.landmarks, "boxes": atlas.boxes, "depth": atlas.depth,
            "color": np.uint8(atlas.color * 255 + 0.5), "owner": atlas.owner,
            "shape_normals": atlas.shape.normals, "shape_low": atlas.shape.low,
            "shape_cell": np.float64(atlas.shape.cell), "labels": labels,
            "regions": np.array(regions), "pose": cameras.pose, "focal": cameras.focal,
            "center": cameras.center, "width": cameras.width, "height": cameras.height, **lists,
            **more})


def load_skin(path: Path, key: str) -> Skin | None:
    """The skin in a file; None if there is none, or it was made of something else.

    What others keep in the file is in the skin's ``kept``, by its names there.
    """
    try:
        arrays = map_arrays(path)
        return _skin_of(arrays) if str(arrays["key"]) == key else None
    except UNREADABLE_ARRAYS:
        return None


def _skin_of(arrays: dict[str, NDArray[Any]]) -> Skin:
    """The skin that a file's arrays describe."""
    cameras = Camera(*(arrays[name] for name in ("pose", "focal", "center", "width", "height")))
    shape = Shape(arrays["shape_normals"], arrays["shape_low"], float(arrays["shape_cell"]))
    atlas = Atlas(cameras, arrays["boxes"], arrays["depth"], arrays["color"], arrays["owner"],
                  shape)
    lists: dict[str, Any] = {
        name: value.astype(np.float32) if value.dtype == np.float16 else value
        for name in _LISTS if (value := arrays.get(name)) is not None}
    theirs = {name: value for name, value in arrays.items() if name not in _OURS}
    # Regions are asked for by every painting.
    kept = {**theirs, "labels": (arrays["labels"], tuple(arrays["regions"].tolist()))}
    return Skin(atlas, HeadPlane(arrays["landmarks"]), float(arrays["pixels"]),
                **{"hair": None, "kept": kept, **lists})
