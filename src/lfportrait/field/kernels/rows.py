"""Rows of a lattice: which are next to each other, those of a finer lattice, and means of states.

A lattice is a table of links into rows: of each point that has one, a density and colors.
"""

from __future__ import annotations

import numpy as np

from ...simd.decorators import lean_kernel
from ...simd.threads import shared


@shared("links")
@lean_kernel
def fill_neighbours(since, until, links, found):
    """Fill int32 [N, 6]: next along x, y, z, previous along x, y, z; the row itself without one.

    ``links`` int32 [Z, Y, X] has the row of each lattice point, or -1.
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


def refine_rows(links, density, rows, keep, low, part, shape):
    """Density and color rows of a finer lattice: a point lives where a corner of its cell does.

    Parameters
    ----------
    links : int32 [Z, Y, X], row of each coarse point or -1.
    density, rows : float32 [N + 1] and [N + 1, width].
    keep : bool [Z, Y, X], the coarse points about which fine ones live.
    low, part : Coarse cell and place inside it of each fine plane, per axis (z, y, x): int64 and
        float32 [3, longest side].
    shape : Fine points along z, y, x.

    Returns
    -------
    links, density, rows : int32 [Z', Y', X'], float32 [M + 1] and [M + 1, width], the last row
        zero. Color is the mean over the corners that exist: empty points have none to mix in.
    """
    fine = np.empty(shape, np.int32)
    counts = np.empty(shape[0], np.int64)
    _find(keep, low, fine, counts)
    ends = np.cumsum(counts)
    total = int(ends[-1])
    fine_density, fine_rows = np.empty(total + 1, np.float32), np.empty((total + 1, rows.shape[1]),
                                                                        np.float32)
    fine_density[total], fine_rows[total] = 0.0, 0.0
    _refine(links, density, rows, ends - counts, low, part, fine, fine_density, fine_rows)
    return fine, fine_density, fine_rows


@shared("fine")
@lean_kernel
def _find(since, until, keep, low, fine, counts):
    """Mark fine points that live by 0 and others by -1; count those of each plane."""
    for z in range(since, until):
        count = 0
        for y in range(fine.shape[1]):
            for x in range(fine.shape[2]):
                k, j, i = low[0, z], low[1, y], low[2, x]
                lives = (keep[k, j, i] | keep[k, j, i + 1] | keep[k, j + 1, i]
                         | keep[k, j + 1, i + 1] | keep[k + 1, j, i] | keep[k + 1, j, i + 1]
                         | keep[k + 1, j + 1, i] | keep[k + 1, j + 1, i + 1])
                fine[z, y, x] = 0 if lives else -1
                count += lives
        counts[z] = count


@shared("fine")
@lean_kernel
def _refine(since, until, links, density, rows, firsts, low, part, fine, fine_density, fine_rows):
    """Number the fine points, those of each plane from its first number on; fill their rows."""
    width, one = rows.shape[1], np.float32(1.0)
    for z in range(since, until):
        point = firsts[z]
        for y in range(fine.shape[1]):
            for x in range(fine.shape[2]):
                if fine[z, y, x] < 0:
                    continue
                fine[z, y, x] = point
                mass, dense = np.float32(0.0), np.float32(0.0)
                for i in range(width):
                    fine_rows[point, i] = np.float32(0.0)
                for corner in range(8):
                    dz, dy, dx = corner >> 2, (corner >> 1) & 1, corner & 1
                    row = links[low[0, z] + dz, low[1, y] + dy, low[2, x] + dx]
                    if row < 0:
                        continue
                    weight = ((part[0, z] if dz else one - part[0, z])
                              * (part[1, y] if dy else one - part[1, y])
                              * (part[2, x] if dx else one - part[2, x]))
                    dense += weight * density[row]
                    mass += weight
                    for i in range(width):
                        fine_rows[point, i] += weight * rows[row, i]
                scale = one / max(mass, np.float32(1e-6))
                for i in range(width):
                    fine_rows[point, i] *= scale
                fine_density[point] = dense
                point += 1


@shared("sums")
@lean_kernel
def put_means(since, until, sums, columns, count, rows, first):
    """Write means into the first columns of rows; one state is written as it is.

    Parameters
    ----------
    sums : float32 [M, columns or more].
    columns : How many values of a row are written.
    count : Number of states, a float32.
    rows : float32 [first + M or more, columns or more], written.
    first : The row that the first sums belong to.
    """
    for row in range(since, until):
        for column in range(columns):
            rows[first + row, column] = sums[row, column] / count


@shared("sums")
@lean_kernel
def add_rows(since, until, sums, rows):
    """Add the first columns of rows, float32 [N, width], to sums, float32 [N, columns]."""
    for row in range(since, until):
        for column in range(sums.shape[1]):
            sums[row, column] += rows[row, column]
