"""Hot loop of the patchwork behind the cheeks (`back_of_head`): the nearest site of each place.

Sites are the jittered middles of square cells, one each; the nearest one lies in the place's own
cell or in one of the eight around it.
"""

from __future__ import annotations

import numba
import numpy as np

from ...simd.decorators import lean_kernel
from ...simd.threads import shared

__all__ = ["nearest_sites"]


@numba.njit(cache=True, inline="always")
def _nearest(x, y, share, first, sites):
    """Row and column of the site nearest to (x, y)."""
    i, j = np.int64(np.floor(x * share)) - first[0], np.int64(np.floor(y * share)) - first[1]
    best, row, column = np.float32(np.inf), np.int64(0), np.int64(0)
    for v in range(max(j - 1, 0), min(j + 2, sites.shape[0])):
        for u in range(max(i - 1, 0), min(i + 2, sites.shape[1])):
            dx, dy = x - sites[v, u, 0], y - sites[v, u, 1]
            distance = dx * dx + dy * dy
            if distance < best:
                best, row, column = distance, v, u
    return row, column


@shared("places")
@lean_kernel
def nearest_sites(since, until, places, side, first, sites, out):
    """Flat number of the site nearest to each of ``places`` [N, 2], into ``out`` int32 [N].

    ``sites`` float32 [Y, X, 2] are those of the cells ``first`` + (i, j), of ``side`` each.
    """
    share = np.float32(1) / np.float32(side)
    for n in range(since, until):
        row, column = _nearest(places[n, 0], places[n, 1], share, first, sites)
        out[n] = row * sites.shape[1] + column
