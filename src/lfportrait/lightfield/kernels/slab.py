"""A slice of the field: what the plane of one panel row cuts out of it, laid out for casting.

For every lattice plane z = k the slice has 13 rows of float16 values along x: density, then four
coefficients of the color's angle for each channel (see `plane`). Values are interpolated between
the two rows of voxels that the plane passes between. Only stretches with voxels are written.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...lanes.cache_keys import identified
from ...lanes.decorators import lean
from ...lanes.shuffles import make_restrict, make_store_columns, store_half
from ...lanes.vectors import LANES

__all__ = ["AHEAD", "LINES", "make_build", "pitch_of"]

LINES = 13
"""Rows of a plane: density and 3 x 4 coefficients."""
AHEAD = 2
"""Values before a row's first, always empty."""


@identified("slab pitch")
@lean
def pitch_of(nx):
    """Values from one row to the next: `AHEAD`, the row, and room for 64 values from its end on."""
    return nx + 66 + AHEAD


def make_build(width: int, count: int) -> Callable[..., Any]:
    """The function that fills a slice.

    Parameters
    ----------
    width, count
        Width of the field's color rows, and coefficients a channel in them.

    Returns
    -------
    build
        ``build(table, links, density, rows, blocks, shape, plane, empty, matrix, threshold, shift,
        stride, slab, low, high, marks, columns)``: the field's bricks, the lattice points along
        x, y, z and the plane, lattice row plane[0] + plane[1] i + plane[2] k at column i of plane
        k; ``matrix`` as `plane_matrix` makes it. It fills every ``stride``-th plane of ``slab``
        uint16 [nz * LINES * pitch], the first and last filled column ``low`` and ``high`` int64
        [nz], and ``marks`` uint64 [nz]: bit b where densities over ``threshold`` reach into columns
        b << shift to (b + 1) << shift. ``columns`` uint16 [256] is scratch.
    """
    floats, ints, iota, where = LANES.floats, LANES.ints, LANES.iota, LANES.where
    gather, gather_pair, bits, lowest = LANES.gather, LANES.gather_pair, LANES.bits, LANES.lowest
    load_half, lane_of = LANES.load_half, LANES.lane
    minimum, maximum = LANES.minimum, LANES.maximum
    restrict, store_columns = make_restrict(count), make_store_columns(LINES - 1)
    two = width == 32
    one, zero = np.float32(1.0), np.float32(0.0)

    @identified("slab build", width, count)
    @lean
    def build(table, links, density, rows, blocks, shape, plane, empty, matrix, threshold, shift,
              stride, slab, low, high, marks, columns):
        nx, ny, nz = shape[0], shape[1], shape[2]
        pitch = pitch_of(nx)
        for k in range(nz - 1, -1, -stride):
            # Forget what the last slice left here.
            base = k * LINES * pitch + AHEAD
            for i in range(low[k], high[k] + 1):
                slab[base + i] = 0
            low[k], high[k], marks[k] = nx, -1, np.uint64(0)
            bz = min(k >> 2, table.shape[0] - 1)
            start_y, step_y = plane[0] + plane[2] * k, plane[1]
            j0 = int(np.floor(min(start_y, start_y + step_y * nx)))
            j1 = int(np.floor(max(start_y, start_y + step_y * nx)))
            if j1 < 0 or j0 > ny - 2:
                continue
            somewhere = np.uint64(0)
            for by in range(max(j0, 0) >> 2, (min(j1, ny - 2) >> 2) + 1):
                somewhere |= blocks[bz, by]
            inner_z = np.int32((k - 4 * bz) * 25)
            for x in range(0, nx, 16):
                if (somewhere >> np.uint64(min(x >> 4, 63))) & np.uint64(1) == 0:
                    continue
                i = iota() + np.int32(x)
                y = floats(i) * np.float32(step_y) + np.float32(start_y)
                fits = ((i < np.int32(nx)) & (y >= zero)
                        & (y <= np.float32(ny - 1)))
                i = minimum(i, np.int32(nx - 1))
                y = maximum(minimum(y, np.float32(ny - 1)), zero)
                j = minimum(ints(y), np.int32(ny - 2))
                part = y - floats(j)
                bx = minimum(i >> np.int32(2), np.int32(table.shape[2] - 1))
                by = j >> np.int32(2)
                brick = gather(table, (by + np.int32(bz * table.shape[1]))
                               * np.int32(table.shape[2]) + bx)
                fits = fits & (brick >= np.int32(0))
                if bits(fits) == 0:
                    continue
                slot = (maximum(brick, np.int32(0)) * np.int32(128) + inner_z
                        + (j - (by << np.int32(2))) * np.int32(5) + (i - (bx << np.int32(2))))
                row0, row1 = gather(links, slot), gather(links, slot + np.int32(5))
                found = fits & ((row0 != np.int32(empty)) | (row1 != np.int32(empty)))
                word = bits(found)
                if word == 0:
                    continue
                d0, _ = gather_pair(density, slot)
                d1, _ = gather_pair(density, slot + np.int32(5))
                sigma = d0 + part * (d1 - d0)
                store_half(slab, np.uintp(base + x), where(found, sigma, zero))
                # A stretch begins and ends with an empty point.
                if word & np.uint32(1) and high[k] < x - 1:
                    for line in range(1, LINES):
                        slab[base + line * pitch + x - 1] = 0
                if word >> np.uint32(15):
                    for line in range(1, LINES):
                        slab[base + line * pitch + x + 16] = 0
                low[k], high[k] = min(low[k], x), x + 15
                dense = bits(found & (sigma > threshold))
                while dense != 0:
                    at = x + np.int64(lowest(dense))
                    dense &= dense - np.uint32(1)
                    marks[k] |= ((np.uint64(1) << np.uint64(max(at - 1, 0) >> shift))
                                 | (np.uint64(1) << np.uint64(at >> shift)))
                columns[:] = 0
                while word != 0:
                    lane = lowest(word)
                    word &= word - np.uint32(1)
                    share = lane_of(part, lane)
                    place0 = np.uintp(lane_of(row0, lane)) * np.uintp(width)
                    place1 = np.uintp(lane_of(row1, lane)) * np.uintp(width)
                    head = ((one - share) * load_half(rows, place0)
                            + share * load_half(rows, place1))
                    rest = head
                    if two:
                        rest = ((one - share) * load_half(rows, place0 + np.uintp(16))
                                + share * load_half(rows, place1 + np.uintp(16)))
                    store_half(columns, np.uintp(lane) * np.uintp(16),
                               restrict(head, rest, matrix))
                store_columns(slab, np.uintp(base + pitch + x), np.uintp(pitch), columns)
    return build
