"""Hot loops of the materials (`painter.materials`): dominant materials and their places."""

from __future__ import annotations

import numpy as np

from ...simd.decorators import lean_kernel
from ...simd.threads import shared

__all__ = ["largest_share", "move_into"]


@shared("shares")
@lean_kernel
def largest_share(since, until, shares, out):
    """The first of each row's largest values, float32 [N, M], into ``out`` int64 [N]."""
    for n in range(since, until):
        best = 0
        for m in range(1, shares.shape[1]):
            if shares[n, m] > shares[n, best]:
                best = m
        out[n] = best


@shared("position")
@lean_kernel
def move_into(since, until, position, material, nearest, out):
    """Positions [N, 2], moved to the nearest pixel of each place's material, into ``out``.

    Parameters
    ----------
    position, material
        float32 [N, 2] (x, y) and int64 [N].
    nearest
        int32 [M, h, w], flat index of the nearest pixel of each material.
    out
        float32 [N, 2]; a position in its own material stays as it is.
    """
    height, width = nearest.shape[1], nearest.shape[2]
    for n in range(since, until):
        x = np.int64(min(max(position[n, 0], np.float32(0)), np.float32(width - 1)))
        y = np.int64(min(max(position[n, 1], np.float32(0)), np.float32(height - 1)))
        near = nearest[material[n], y, x]
        if near == y * width + x:
            out[n, 0], out[n, 1] = position[n, 0], position[n, 1]
        else:
            out[n, 0] = np.float32(near % width) + np.float32(0.5)
            out[n, 1] = np.float32(near // width) + np.float32(0.5)
