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
from ...lanes.interleaved import prefetch
from ...lanes.shuffles import store_half
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


def make_build(count: int) -> Callable[..., Any]:
    """The function that fills a slice.

    Parameters
    ----------
    count
        Coefficients a channel of the field's colors.

    Returns
    -------
    build
        ``build(places, occupied, values, shape, plane, matrix, threshold, shift, stride, slab, low,
        high, marks)``: the field's `Stretches`, the lattice points along x, y, z and the plane,
        lattice row plane[0] + plane[1] i + plane[2] k at column i of plane k; ``matrix`` as
        `plane_matrix` makes it. It fills every ``stride``-th plane of ``slab`` uint16
        [nz * LINES * pitch], the first and last filled column ``low`` and ``high`` int64 [nz], and
        ``marks`` uint64 [nz]: bit b where densities over ``threshold`` reach into columns
        b << shift to (b + 1) << shift.
    """
    floats, ints, iota, where = LANES.floats, LANES.ints, LANES.iota, LANES.where
    bits, lowest, lane_of, load_half = LANES.bits, LANES.lowest, LANES.lane, LANES.load_half
    minimum, maximum = LANES.minimum, LANES.maximum
    lines = 1 + 3 * count
    # A channel's terms that a direction needs: with one coefficient the first, with four no sin 2.
    terms = {1: 1, 4: 3}.get(count, 4)
    one, zero = np.float32(1.0), np.float32(0.0)

    @identified("slab build", count)
    @lean
    def build(places, occupied, values, shape, plane, matrix, threshold, shift, stride, slab, low,
              high, marks):
        nx, ny, nz = shape[0], shape[1], shape[2]
        pitch = pitch_of(nx)
        for k in range(nz - 1, -1, -stride):
            # Forget what the last slice left here.
            base = k * LINES * pitch + AHEAD
            for i in range(low[k], high[k] + 1):
                slab[base + i] = 0
            low[k], high[k], marks[k] = nx, -1, np.uint64(0)
            start_y, step_y = plane[0] + plane[2] * k, plane[1]
            j0 = int(np.floor(min(start_y, start_y + step_y * nx)))
            j1 = int(np.floor(max(start_y, start_y + step_y * nx)))
            if j1 < 0 or j0 > ny - 2:
                continue
            somewhere = np.uint64(0)
            for j in range(max(j0, 0), min(j1 + 2, ny)):
                somewhere |= occupied[j, k]
            for block in range(places.shape[2]):
                if (somewhere >> np.uint64(min(block, 63))) & np.uint64(1) == 0:
                    continue
                x = 16 * block
                y = floats(iota() + np.int32(x)) * np.float32(step_y) + np.float32(start_y)
                fits = (y >= zero) & (y <= np.float32(ny - 1))
                y = maximum(minimum(y, np.float32(ny - 1)), zero)
                row = minimum(ints(y), np.int32(ny - 2))
                part = y - floats(row)
                first, last = lane_of(row, 0), lane_of(row, 15)
                since, until = min(first, last), max(first, last) + 1
                # The slices after this one lie lower: ask for what they will need first.
                below = np.uintp(places[max(since - 1, 0), k, block]) * np.uintp(lines * 16)
                for ahead in range(0, lines * 16, 32):
                    prefetch(values, below + np.uintp(ahead))
                sigma = floats(zero)
                for j in range(since, until):
                    here = fits & (row == np.int32(j))
                    place0 = np.uintp(places[j, k, block]) * np.uintp(lines * 16)
                    place1 = np.uintp(places[j + 1, k, block]) * np.uintp(lines * 16)
                    sigma = (sigma + where(here, one - part, zero) * load_half(values, place0)
                             + where(here, part, zero) * load_half(values, place1))
                store_half(slab, np.uintp(base + x), sigma)
                dense = bits(sigma > threshold)
                while dense != 0:
                    at = x + np.int64(lowest(dense))
                    dense &= dense - np.uint32(1)
                    marks[k] |= ((np.uint64(1) << np.uint64(max(at - 1, 0) >> shift))
                                 | (np.uint64(1) << np.uint64(at >> shift)))
                # What is next to a stretch is empty, unless another one follows.
                for channel in range(3):
                    for term in range(terms):
                        line = base + (1 + 4 * channel + term) * pitch
                        if high[k] < x - 1:
                            slab[line + x - 1] = 0
                        slab[line + x + 16] = 0
                low[k], high[k] = min(low[k], x), x + 15
                for channel in range(3):
                    level, cosine, sine, mixed = floats(zero), floats(zero), floats(zero), floats(
                        zero)
                    for j in range(since, until):
                        here = fits & (row == np.int32(j))
                        share0, share1 = where(here, one - part, zero), where(here, part, zero)
                        place0 = np.uintp(places[j, k, block]) * np.uintp(lines * 16)
                        place1 = np.uintp(places[j + 1, k, block]) * np.uintp(lines * 16)
                        for coefficient in range(count):
                            away = np.uintp(16 * (1 + channel * count + coefficient))
                            value = (share0 * load_half(values, place0 + away)
                                     + share1 * load_half(values, place1 + away))
                            at = 16 * coefficient + 4 * channel
                            level = level + matrix[at] * value
                            if terms > 1:
                                cosine = cosine + matrix[at + 1] * value
                                sine = sine + matrix[at + 2] * value
                            if terms > 3:
                                mixed = mixed + matrix[at + 3] * value
                    line = np.uintp(base + (1 + 4 * channel) * pitch + x)
                    store_half(slab, line, level)
                    if terms > 1:
                        store_half(slab, line + np.uintp(pitch), cosine)
                        store_half(slab, line + np.uintp(2 * pitch), sine)
                    if terms > 3:
                        store_half(slab, line + np.uintp(3 * pitch), mixed)
    return build
