"""Files of expensive results: a skin beside its field.

A skin's file knows what it was made of: it is used for that field and those landmarks alone. Of its
pictures it holds the pixels with something in them, packed without loss (`lfportrait.packed`); what
follows from these in hundredths of a second is left out, and made again when the file is read.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cache import key_of
from ...capture import Camera
from ...files import UNREADABLE_ARRAYS, atomic_write, map_arrays, write_mappable
from ...packed import check, pack, unpack
from ...simd.threads import side_by_side
from ..surface_guide import HeadPlane
from .charts import Atlas, Shape
from .sitter import Skin

Arrays = dict[str, NDArray[Any]]

_SHARES = ("tone", "detail", "appearance", "contours", "hair", "clothes", "ears", "seen")
"""Lists of a skin with no more than a thousand steps: they are rounded to float16."""
_CAMERAS = ("pose", "focal", "center", "width", "height")
_ORDERS = {"labels": 0, **dict.fromkeys(("depths", "rows", *_SHARES), 2)}
"""What is not packed as first differences: most labels are 0 or 255, and what is smooth has small
second ones."""
_PACKED = ("colors", "depths", "owners", "labels", "rows", "solid", "known", "lit", "normals",
           "outwards", *_SHARES)
_COLORS = ("size", "lit", "colors")
_PLAIN = ("boxes", "low", "cell", "landmarks", "pixels", "regions", *_CAMERAS, *_COLORS)


def skin_key(*made_of: Any) -> str:
    """What a skin and the form of its file depend on, as a short text."""
    return key_of(__name__, *made_of)


def as_stored(skin: Skin, key: str) -> Skin:
    """A skin as it comes back from its file: with rounded numbers, and the key in its ``kept``."""
    atlas = replace(skin.atlas, shown=np.asarray(skin.atlas.color * 255 + 0.5, np.uint8))
    shares = {name: value.astype(np.float16).astype(np.float32) for name in _SHARES
              if (value := getattr(skin, name)) is not None}
    return replace(skin, atlas=atlas, kept={"key": key, "labels": skin.labels}, **shares)


def save_skin(skin: Skin, path: Path, key: str) -> None:
    """Write a skin, and the key of what it was made of."""
    atlas = skin.atlas
    arrays = {**_pictures(atlas), "normals": atlas.shape.normals, "labels": skin.labels[0],
              "rows": skin.rows, "outwards": skin.outwards,
              **{name: value.astype(np.float16) for name in _SHARES
                 if (value := getattr(skin, name)) is not None}}
    names = [name for name in _PACKED if name in arrays]
    packed = side_by_side(lambda name: pack(arrays[name], _ORDERS.get(name, 1)), names)
    with atomic_write(path) as stream:
        write_mappable(stream, {
            "key": np.str_(key), "pixels": np.float64(skin.pixels),
            "landmarks": skin.plane.landmarks, "size": np.array(atlas.depth.shape),
            "boxes": atlas.boxes, "low": atlas.shape.low, "cell": np.float64(atlas.shape.cell),
            "regions": np.array(skin.labels[1]),
            **{name: getattr(atlas.cameras, name) for name in _CAMERAS},
            **dict(zip(names, packed))})


def _pictures(atlas: Atlas) -> Arrays:
    """The pixels of an atlas that hold something, and where they are."""
    color = np.asarray(atlas.color * 255 + 0.5, np.uint8)
    solid, lit, known = np.isfinite(atlas.depth), np.any(color, axis=2), atlas.owner >= 0
    colors = color[lit]
    colors[:, ::2] -= colors[:, 1:2]  # what is left of red and blue is small
    return {"depths": atlas.depth[solid], "owners": atlas.owner[known], "colors": colors,
            "solid": solid, "known": known, "lit": lit}


def load_skin(path: Path, key: str) -> Skin | None:
    """The skin in a file; None if there is none, or it was made of something else."""
    try:
        arrays = map_arrays(path)
        return _skin_of(arrays, key) if str(arrays["key"]) == key else None
    except UNREADABLE_ARRAYS:
        return None


def _skin_of(arrays: Arrays, key: str) -> Skin:
    """The skin that a file's arrays describe."""
    found = dict(zip(_READ, side_by_side(lambda read: read(arrays), list(_READ.values()))))
    # Copies: the file is not held open.
    plain = {name: np.array(arrays[name]) for name in _PLAIN}
    shape = Shape(found["normals"], plain["low"], float(plain["cell"]))
    for name in ("lit", "colors"):  # unpacked later, as a preview has no use for them
        check(plain[name])
    atlas = Atlas(Camera(*(plain[name] for name in _CAMERAS)), plain["boxes"], found["depth"],
                  functools.partial(_color, {name: plain[name] for name in _COLORS}),
                  found["owner"], shape)
    # Regions are asked for by every painting.
    kept: dict[Hashable, Any] = {
        "key": key, "labels": (found["labels"], tuple(plain["regions"].tolist()))}
    return Skin(atlas, HeadPlane(plain["landmarks"]), float(plain["pixels"]),
                np.flatnonzero(atlas.own).astype(np.int32),
                **{name: found[name] for name in _SHARES}, outwards=found["outwards"],
                rows=found["rows"], kept=kept)


def _picture(arrays: Arrays, where: str, values: NDArray[Any], empty: float) -> NDArray[Any]:
    """A picture of the atlas from the values of some of its pixels."""
    picture = np.full((*arrays["size"].tolist(), *values.shape[1:]), empty, values.dtype)
    # Whole pixels are copied at once: of bytes that takes a twentieth of the time.
    pixel = np.dtype((np.void, values[:1].nbytes))
    picture.view(pixel).reshape(picture.shape[:2])[unpack(arrays[where])] = values.view(
        pixel).reshape(len(values))
    return picture


def _depth(arrays: Arrays) -> NDArray[Any]:
    return _picture(arrays, "solid", unpack(arrays["depths"]), np.inf)


def _color(arrays: Arrays) -> NDArray[Any]:
    colors = unpack(arrays["colors"])
    colors[:, ::2] += colors[:, 1:2]
    return _picture(arrays, "lit", colors, 0)


def _owner(arrays: Arrays) -> NDArray[Any]:
    return _picture(arrays, "known", unpack(arrays["owners"]), -1)


def _list(name: str) -> Callable[[Arrays], NDArray[Any] | None]:
    """What reads an array that is whole in the file, if it is there."""
    def read(arrays: Arrays) -> NDArray[Any] | None:
        if name == "hair" and name not in arrays:
            return None
        values = unpack(arrays[name])
        return values.astype(np.float32) if name in _SHARES else values

    return read


_READ: dict[str, Callable[[Arrays], Any]] = {
    "depth": _depth, "owner": _owner,
    **{name: _list(name) for name in ("rows", "labels", "normals", "outwards", *_SHARES)}}
"""What reads each part of a skin that is always needed; what takes longest comes first."""
