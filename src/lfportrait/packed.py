"""Arrays in few bytes, exactly: differences of neighbours, deflated byte by byte.

Neighbours in a list of measured numbers are alike. Their differences (of a float's bits, too, which
order floats as their values do) are small: high bytes are nearly all zero, and low bytes are noise,
which stay as they are. The first bytes of all numbers are deflated together, then the second ones,
and so on, with runs and Huffman's code alone. A hundred megabytes take a second, and less to read.
"""

from __future__ import annotations

import itertools
import json
import math
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import UInt8

MOST = 0.75
"""A plane of bytes that is not deflated to less than this share is stored as it is."""
_WORD = 4
"""Bytes of the header's length and of the sum over all."""
_BARE = -zlib.MAX_WBITS
"""zlib's name for a stream without a sum of its own."""

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
