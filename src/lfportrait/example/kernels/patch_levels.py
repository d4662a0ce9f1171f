"""Hot loops between the levels of guided patch synthesis: rescaling of the patch places."""

from __future__ import annotations

import numpy as np

from ...simd.decorators import lean_kernel
from ...simd.threads import shared
from .patches import FIXED, MARGIN

__all__ = ["finer_places", "level_places"]


@shared("out")
@lean_kernel
def level_places(since, until, places, step, size, out):
    """Places of a level's pixels as flat indices, into ``out`` int32 [h, w].

    ``places`` float32 [H, W, 2] (x, y) are those of the finest level, whose pixels in the middle of
    ``step`` x ``step`` are asked; ``size`` (rows, columns) is the exemplar's on the level. Places
    keep a patch's margin from its border; unknown ones (NaN) go to its corner.
    """
    height, width = places.shape[:2]
    rows, columns = size
    least = np.float32(MARGIN)
    low, right = np.float32(rows - 1 - MARGIN), np.float32(columns - 1 - MARGIN)
    share = np.float32(1) / np.float32(step)
    for y in range(since, until):
        v = min(y * step + step // 2, height - 1)
        for x in range(out.shape[1]):
            u = min(x * step + step // 2, width - 1)
            column, row = places[v, u, 0] * share, places[v, u, 1] * share
            # A comparison with NaN is false.
            column = min(column, right) if column > least else least
            row = min(row, low) if row > least else least
            out[y, x] = np.int32(row) * np.int32(columns) + np.int32(column)


@shared("out")
@lean_kernel
def finer_places(since, until, places, across, state, start, size, out):
    """What a level found, on the next finer one, into ``out`` int32 [H, W].

    ``places`` int32 [h, w] are flat indices into an exemplar ``across`` pixels wide, ``size`` is
    (rows, columns) of the finer one; where the ``state`` is `FIXED` ``start`` int32 [H, W] holds.
    """
    rows, columns = size
    for y in range(since, until):
        for x in range(out.shape[1]):
            if state[y, x] == FIXED:
                out[y, x] = start[y, x]
                continue
            place = places[y // 2, x // 2]
            row, column = 2 * (place // across) + y % 2, 2 * (place % across) + x % 2
            row = min(max(row, MARGIN), rows - 1 - MARGIN)
            column = min(max(column, MARGIN), columns - 1 - MARGIN)
            out[y, x] = np.int32(row * columns + column)
