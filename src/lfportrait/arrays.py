"""Names of array types, one an element type (docstrings say the shapes); the box about a mask."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]
Floats: TypeAlias = NDArray[np.floating]
Float16: TypeAlias = NDArray[np.float16]
Float32: TypeAlias = NDArray[np.float32]
Float64: TypeAlias = NDArray[np.float64]
Unsigned: TypeAlias = NDArray[np.unsignedinteger]
UInt8: TypeAlias = NDArray[np.uint8]
UInt16: TypeAlias = NDArray[np.uint16]
UInt32: TypeAlias = NDArray[np.uint32]
UInt64: TypeAlias = NDArray[np.uint64]
Int8: TypeAlias = NDArray[np.int8]
Int32: TypeAlias = NDArray[np.int32]
Int64: TypeAlias = NDArray[np.int64]
Bool: TypeAlias = NDArray[np.bool_]


def box_about(mask: Array, margin: int = 0) -> tuple[slice, ...] | None:
    """The box about what is true in a mask, by so much wider on all sides; None if nothing is."""
    sides, rest = [], mask
    for size in mask.shape:
        along = np.flatnonzero(rest.any(axis=tuple(range(1, rest.ndim))))
        if not len(along):
            return None
        sides.append(slice(max(int(along[0]) - margin, 0), min(int(along[-1]) + margin + 1, size)))
        rest = np.asarray(rest.any(axis=0))
    return tuple(sides)
