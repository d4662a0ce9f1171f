"""Hot loops of the exact look-up table (Eq. 6): a distance transform that carries the arg-min.

A cell holds one 64-bit key: the cost in the upper bits, the flat index of the exemplar's pixel in
the lower `INDEX_BITS`. The minimum of two keys is then the cheaper pixel and, at equal cost, the
one that comes first in scan order: the tie rule needs no code of its own. Adding a cost to a key
leaves the index alone, so the transform is separable exactly as plain distances are: a sweep along
x, one along y, one along the appearance.
"""

import numba
import numpy as np

from ...simd.decorators import kernel, lean, lean_kernel
from ...simd.threads import share_out, shared

INDEX_BITS = 28
EMPTY = np.int64(1) << 60
_MASK = (np.int64(1) << INDEX_BITS) - 1


def scatter_pixels(levels, cell, keys):
    """Put every exemplar pixel into its cell of ``keys`` [A, Y, X].

    ``levels`` int32 [H, W] is the quantised appearance. Within a cell the pixel nearest to the
    cell's middle is kept (first in scan order among equals); its cost is 0. All other cells are
    `EMPTY`.
    """
    share_out(_scatter_rows, keys.shape[1], levels, cell, keys)


@kernel
def _scatter_rows(since, until, levels, cell, keys):
    """`scatter_pixels` into some rows of cells."""
    height, width = levels.shape
    for j in range(since, until):
        keys[:, j] = EMPTY
        best = np.full((keys.shape[0], keys.shape[2]), 1 << 30, np.int32)
        for y in range(j * cell, min((j + 1) * cell, height)):
            for x in range(width):
                i = x // cell
                a = levels[y, x]
                dx = 2 * x + 1 - (2 * i + 1) * cell
                dy = 2 * y + 1 - (2 * j + 1) * cell
                off = dx * dx + dy * dy
                if off < best[a, i]:
                    best[a, i] = off
                    keys[a, j, i] = y * width + x


def sweep_linear(keys, step_x, step_y, step_a):
    """Weighted L1 distance transform of ``keys`` [A, Y, X] in place; steps are costs per cell."""
    move_x, move_y, move_a = (np.int64(step) << INDEX_BITS for step in (step_x, step_y, step_a))
    share_out(_sweep_places, keys.shape[0], keys, move_x, move_y)
    share_out(_sweep_levels, keys.shape[1], keys, move_a)


@lean_kernel
def _sweep_places(since, until, keys, move_x, move_y):
    """The sweeps along x and y, of some levels."""
    rows, columns = keys.shape[1:]
    for a in range(since, until):
        for y in range(rows):
            for x in range(1, columns):
                keys[a, y, x] = min(keys[a, y, x], keys[a, y, x - 1] + move_x)
            for x in range(columns - 2, -1, -1):
                keys[a, y, x] = min(keys[a, y, x], keys[a, y, x + 1] + move_x)
        for y in range(1, rows):
            for x in range(columns):
                keys[a, y, x] = min(keys[a, y, x], keys[a, y - 1, x] + move_y)
        for y in range(rows - 2, -1, -1):
            for x in range(columns):
                keys[a, y, x] = min(keys[a, y, x], keys[a, y + 1, x] + move_y)


@lean_kernel
def _sweep_levels(since, until, keys, move_a):
    """The sweep along the appearance, of some rows."""
    levels, _, columns = keys.shape
    for y in range(since, until):
        for a in range(1, levels):
            for x in range(columns):
                keys[a, y, x] = min(keys[a, y, x], keys[a - 1, y, x] + move_a)
        for a in range(levels - 2, -1, -1):
            for x in range(columns):
                keys[a, y, x] = min(keys[a, y, x], keys[a + 1, y, x] + move_a)


@numba.njit(cache=True, inline="always")
def _nearest_squared(row, weight):
    """Distance transform of a row whose keys cost nothing or are `EMPTY`: the nearer side wins."""
    last, columns = np.int64(-1), row.shape[0]
    own = np.int64(0)
    for x in range(columns):
        if row[x] < EMPTY:
            last, own = x, row[x]
        elif last >= 0:
            row[x] = own + ((weight * (x - last) * (x - last)) << INDEX_BITS)
    last = np.int64(-1)
    for x in range(columns - 1, -1, -1):
        if row[x] >> INDEX_BITS == 0:
            last, own = x, row[x]
        elif last >= 0:
            row[x] = min(row[x], own + ((weight * (last - x) * (last - x)) << INDEX_BITS))


@lean
def _envelope(line, weight, apex, start, out):
    """Lower envelope of the parabolas (key cost + weight d^2) over a line (Felzenszwalb 2012)."""
    count = line.shape[0]
    top = -1
    for q in range(count):
        if line[q] >= EMPTY:
            continue
        height = float(line[q] >> INDEX_BITS) + float(weight) * q * q
        crossing = -1e300
        while top >= 0:
            v = apex[top]
            other = float(line[v] >> INDEX_BITS) + float(weight) * v * v
            crossing = (height - other) / (2.0 * weight * (q - v))
            if crossing > start[top]:
                break
            top -= 1
        top += 1
        apex[top] = q
        start[top] = crossing if top > 0 else -1e300
    if top < 0:
        return
    k = 0
    for i in range(count):
        while k < top and start[k + 1] < i:
            k += 1
        best = line[apex[k]] + (np.int64(weight * (i - apex[k]) ** 2) << INDEX_BITS)
        if k < top:
            # At a crossing both parabolas are equal and the smaller index wins.
            best = min(best, line[apex[k + 1]]
                       + (np.int64(weight * (i - apex[k + 1]) ** 2) << INDEX_BITS))
        out[i] = best
    for i in range(count):
        line[i] = out[i]


def sweep_squared(keys, weight_x, weight_y, weight_a):
    """Weighted squared distance transform of ``keys`` [A, Y, X] in place; weights per cell^2."""
    share_out(_square_places, keys.shape[0], keys, weight_x, weight_y)
    share_out(_square_levels, keys.shape[1], keys, weight_a)


@kernel
def _square_places(since, until, keys, weight_x, weight_y):
    """The transforms along x and y, of some levels."""
    rows, columns = keys.shape[1:]
    apex, start, out = np.empty(rows, np.int64), np.empty(rows), np.empty(rows, np.int64)
    for a in range(since, until):
        for y in range(rows):
            _nearest_squared(keys[a, y], np.int64(weight_x))
        # Columns in bundles, so that whole cache lines are read and written.
        lines = np.empty((8, rows), np.int64)
        for first in range(0, columns, 8):
            count = min(8, columns - first)
            for y in range(rows):
                for c in range(count):
                    lines[c, y] = keys[a, y, first + c]
            for c in range(count):
                _envelope(lines[c], weight_y, apex, start, out)
            for y in range(rows):
                for c in range(count):
                    keys[a, y, first + c] = lines[c, y]


@kernel
def _square_levels(since, until, keys, weight_a):
    """The transform along the appearance, of some rows."""
    levels, _, columns = keys.shape
    apex, start, out = np.empty(levels, np.int64), np.empty(levels), np.empty(levels, np.int64)
    for y in range(since, until):
        lines = np.empty((8, levels), np.int64)
        for first in range(0, columns, 8):
            count = min(8, columns - first)
            for a in range(levels):
                for c in range(count):
                    lines[c, a] = keys[a, y, first + c]
            for c in range(count):
                _envelope(lines[c], weight_a, apex, start, out)
            for a in range(levels):
                for c in range(count):
                    keys[a, y, first + c] = lines[c, a]


@shared("indices")
@lean_kernel
def extract_indices(since, until, keys, indices):
    """Pixel index of every cell: ``indices`` int32 [Y, X, A] from ``keys`` [A, Y, X].

    The appearance is innermost: a pixel's look-up then lies beside those of its neighbours, whose
    place is the same but for a pixel and whose appearance is not.
    """
    for y in range(since, until):
        for a in range(keys.shape[0]):
            for x in range(keys.shape[2]):
                indices[y, x, a] = np.int32(keys[a, y, x] & _MASK)
