"""Dilation and connected pieces of points that fill a small part of their lattice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

__all__ = ["dilated", "labelled"]


def _box(points: NDArray[np.bool_], margin: int = 0) -> tuple[slice, slice, slice] | None:
    """The box about points, by so much wider; None without a point."""
    flat = np.any(points, axis=0)
    sides = [np.flatnonzero(some) for some in (np.any(points, axis=(1, 2)), np.any(flat, axis=1),
                                               np.any(flat, axis=0))]
    if not len(sides[0]):
        return None
    z, y, x = (slice(max(0, int(side[0]) - margin), int(side[-1]) + 1 + margin) for side in sides)
    return z, y, x


def dilated(points: NDArray[np.bool_], steps: int = 1) -> NDArray[np.bool_]:
    """Points, and all that are at most ``steps`` from one along each axis: bool [Z, Y, X].

    It is `scipy.ndimage.binary_dilation` by a cube, axis by axis.
    """
    out = np.zeros(points.shape, bool)
    box = _box(points, steps)
    if box is None:
        return out
    grown = points[box].copy()
    for axis in range(3):
        before = [slice(None)] * 3
        behind = [slice(None)] * 3
        before[axis], behind[axis] = slice(None, -1), slice(1, None)
        for _ in range(steps):
            last = grown.copy()
            grown[tuple(behind)] |= last[tuple(before)]
            grown[tuple(before)] |= last[tuple(behind)]
    out[box] = grown
    return out


def labelled(points: NDArray[np.bool_]) -> tuple[NDArray[np.int32], int]:
    """Pieces of points that touch, also across corners: their numbers from 1, and how many.

    It is `scipy.ndimage.label` with a cube. int32 [Z, Y, X], 0 elsewhere.
    """
    out = np.zeros(points.shape, np.int32)
    box = _box(points)
    if box is None:
        return out, 0
    out[box], count = ndimage.label(points[box], np.ones((3, 3, 3), bool))
    return out, int(count)
