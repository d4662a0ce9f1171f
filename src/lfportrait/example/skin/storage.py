"""Files of expensive results: a skin beside its field, its arrays packed exactly.

A skin's file knows what it was made of: it is used for that field and those landmarks alone. Of its
pictures it holds the pixels with something in them, packed without loss (`pack`); what follows from
these in hundredths of a second is left out, and made again when the file is read.

Neighbours in a list of measured numbers are alike. Their differences (of a float's bits, too, which
order floats as their values do) are small: high bytes are nearly all zero, and low bytes are noise,
which stay as they are. The first bytes of all numbers are deflated together, then the second ones,
and so on, with runs and Huffman's code alone. A hundred megabytes take a second, and less to read.
"""

from __future__ import annotations

import functools
import itertools
import json
import math
import zlib
from collections.abc import Callable, Hashable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import UInt8
from ...cache import key_of
from ...capture import Camera
from ...files import UNREADABLE_ARRAYS, atomic_write, map_arrays, write_mappable
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


MOST = 0.75  # A plane of bytes that is not deflated to less than this share is stored as it is.
_WORD = 4  # Bytes of the header's length and of the sum over all.
_BARE = -zlib.MAX_WBITS  # zlib's name for a stream without a sum of its own.

Words = NDArray[np.unsignedinteger[Any]]


def pack(values: NDArray[Any], order: int = 1) -> UInt8:
    """An array of integers or floats [N] or [..., C], or booleans [...], as bytes for `unpack`.

    Differences are taken ``order`` times: once where the numbers of each of C columns differ little
    from one row to the next, twice where the steps between them do, too; never where most numbers
    are one of a few.
    """
    values = np.ascontiguousarray(values)
    planes: list[bytes] = []
    for row in _columns(values):
        for _ in range(order):
            row = np.diff(row, prepend=row.dtype.type(0))
        row = _folded(row) if order else row
        planes += map(_deflated, row.view(np.uint8).reshape(len(row), row.itemsize).T)
    head = json.dumps({"dtype": values.dtype.str, "shape": values.shape, "order": order,
                       "planes": [len(plane) for plane in planes]}).encode()
    data = b"".join([len(head).to_bytes(_WORD, "little"), head, *planes])
    return np.frombuffer(data + zlib.crc32(data).to_bytes(_WORD, "little"), np.uint8)


def check(data: UInt8) -> None:
    """Raise `ValueError` if packed bytes are damaged: for an array that is unpacked later."""
    wanted = int.from_bytes(data[-_WORD:].tobytes(), "little")
    if len(data) < 2 * _WORD or zlib.crc32(data[:-_WORD].data) != wanted:
        raise ValueError("a packed array is damaged")


def unpack(data: UInt8) -> NDArray[Any]:
    """The array that was packed; `ValueError` if the bytes are damaged."""
    data = np.ascontiguousarray(data, np.uint8)
    check(data)
    begin = _WORD + int.from_bytes(data[:_WORD].tobytes(), "little")
    head = json.loads(data[_WORD:begin].tobytes())
    dtype, shape = np.dtype(head["dtype"]), tuple(head["shape"])
    columns = np.empty(*_form(dtype, shape))
    ends = begin + np.cumsum([0, *head["planes"]])
    pieces = [data[since:until] for since, until in itertools.pairwise(ends)]
    size = columns.itemsize
    for n, row in enumerate(columns):
        planes = row.view(np.uint8).reshape(len(row), size)
        for k, piece in enumerate(pieces[n * size:(n + 1) * size]):
            planes[:, k] = _inflated(piece, len(row))
        if head["order"]:
            _unfold(row)
        for _ in range(head["order"]):
            np.cumsum(row, dtype=row.dtype, out=row)
    if dtype.kind == "b":
        return np.unpackbits(columns[0], count=math.prod(shape)).view(bool).reshape(shape)
    return np.ascontiguousarray(columns.T).view(dtype).reshape(shape)


def _form(dtype: np.dtype[Any], shape: tuple[int, ...]) -> tuple[tuple[int, int], str]:
    """Shape and type of `_columns`."""
    if dtype.kind == "b":
        return (1, -(-math.prod(shape) // 8)), "u1"
    width = shape[-1] if len(shape) > 1 else 1
    return (width, math.prod(shape) // max(width, 1)), f"u{dtype.itemsize}"


def _columns(values: NDArray[Any]) -> Words:
    """The numbers of an array [..., C] as bits, uint [C, N]; of booleans eight a byte, [1, N]."""
    (width, count), bits = _form(values.dtype, values.shape)
    if values.dtype.kind == "b":
        return np.packbits(values).reshape(1, -1)
    return np.ascontiguousarray(values.view(bits).reshape(count, width).T)


def _folded(row: Words) -> Words:
    """Differences, small ones of either sign as small numbers: 0, -1, 1, -2, ... as 0, 1, 2, 3."""
    signed = row.view(f"i{row.itemsize}")
    return np.asarray(((signed << 1) ^ (signed >> (8 * row.itemsize - 1))).view(row.dtype))


def _unfold(row: Words) -> None:
    """Undo `_folded`, in place."""
    signs = row & row.dtype.type(1)
    row >>= row.dtype.type(1)
    row ^= np.negative(signs, out=signs)


def _deflated(plane: UInt8) -> bytes:
    """A plane of bytes in fewer, or as it is."""
    packer = zlib.compressobj(1, zlib.DEFLATED, _BARE, 9, zlib.Z_RLE)
    whole = plane.tobytes()
    data = packer.compress(whole) + packer.flush()
    return data if len(data) < MOST * len(whole) else whole


def _inflated(piece: UInt8, count: int) -> UInt8:
    """A plane of ``count`` bytes."""
    if len(piece) == count:
        return piece
    return np.frombuffer(zlib.decompress(piece.data, _BARE, count), np.uint8)
