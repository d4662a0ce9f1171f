"""The rows next to each row of a lattice, and the points of rows."""

from __future__ import annotations

from ...simd.decorators import lean_kernel
from ...simd.threads import shared

__all__ = ["fill_neighbours", "mark_points"]


@shared("links")
@lean_kernel
def fill_neighbours(since, until, links, found):
    """Fill int32 [N, 6]: next along x, y, z, previous along x, y, z; the row itself without one.

    Parameters
    ----------
    links
        int32 [Z, Y, X], row of each lattice point or -1.
    found
        Written.
    """
    depth, height, width = links.shape
    for z in range(since, until):
        for y in range(height):
            for x in range(width):
                row = links[z, y, x]
                if row < 0:
                    continue
                for side in range(6):
                    step = 1 if side < 3 else -1
                    k = z + step if side % 3 == 2 else z
                    j = y + step if side % 3 == 1 else y
                    i = x + step if side % 3 == 0 else x
                    other = row
                    inside = 0 <= k < depth and 0 <= j < height and 0 <= i < width
                    if inside and links[k, j, i] >= 0:
                        other = links[k, j, i]
                    found[row, side] = other


@shared("links")
@lean_kernel
def mark_points(since, until, links, rows, points):
    """Fill bool [Z, Y, X], the points of marked rows, bool [N + 1]."""
    _, height, width = links.shape
    for z in range(since, until):
        for y in range(height):
            for x in range(width):
                row = links[z, y, x]
                points[z, y, x] = row >= 0 and rows[max(row, 0)]
