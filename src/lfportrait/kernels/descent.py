"""One step down the gradient on the rows that rays touched, and total variation on runs of rows.

Colour is linear in its coefficients, so that a step need not be guessed. As in SART, the
simultaneous algebraic reconstruction technique (Andersen & Kak 1984), a lattice point takes up the
mean error of the rays that it colours, weighted by how much of each ray's light it gives: the
gradient is divided by the sum of those weights, and the sum is remembered, up to a bound, so that
many rays are averaged. One number a point replaces RMSProp's 27, and colours are right after tens
of rays, where steps of a fixed length take thousands. Density is not linear and keeps RMSProp.

A lattice point's gradient is one row: its colour coefficients, the weight of its rays in the last
value but one, and its density's in the last. Rows are 16 or 32 values wide and go through the lanes
of `lfportrait.kernels.lanes`, 16 at a time.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from .lanes import LANES

__all__ = ["descend", "total_variation"]

_floats, _where, _iota, _sqrt = LANES.floats, LANES.where, LANES.iota, LANES.sqrt
_load, _store, _lane = LANES.load, LANES.store, LANES.lane
_FAINT = np.float32(0.02)
"""Weight of rays below which a colour is not trusted: it takes up less of their error."""


@njit(cache=True, parallel=True)
def descend(density, rows, width, gradients, touched, state, rate, decay, lowest, gains, memory):
    """One step on the rows that any worker touched; gradients and marks are set to zero.

    Parameters
    ----------
    density, rows
        float32 [N + 1] and [(N + 1) * width], the parameters; the last row stays as it is.
    width
        Row width, 16 or 32; a row's last two values are no parameters.
    gradients, touched
        float32 [workers, (N + 1) * width] and uint8 [workers, N + 1].
    state
        float32 [N + 1, 2]: running mean of the density's squared gradient, and remembered weight of
        rays.
    rate, decay
        Learning rate of the density, and decay of the running mean (0.95).
    lowest
        Densities are kept at or above this.
    gains
        float32 [width], what a coefficient's gradient is multiplied with to be its change for rays
        of weight one; zero for what is no colour.
    memory
        Weight of rays that a colour is a running mean of, at most. The weight of this step's rays
        counts in full whatever the bound.
    """
    workers = len(gradients)
    rest = np.float32(1.0) - decay
    zero, tiny = np.float32(0.0), np.float32(1e-8)
    last = width // 16 - 1
    for row in prange(touched.shape[1] - 1):
        marks = 0
        for worker in range(workers):
            marks += np.int32(touched[worker, row])
        if marks == 0:
            continue
        scale = zero
        for number in range(last + 1):
            # The last block first: it has the weight.
            block = last - number
            place = np.uintp(row * width + 16 * block)
            gradient = _floats(zero)
            for worker in range(workers):
                if touched[worker, row] != 0:
                    own = gradients[worker]
                    gradient = gradient + _load(own, place)
                    _store(own, place, _floats(zero))
            if number == 0:
                slope, weight = _lane(gradient, 15), _lane(gradient, 14)
                square = decay * state[row, 0] + rest * slope * slope
                change = rate * slope / (np.sqrt(square) + tiny)
                density[row] = max(density[row] - change, lowest)
                known = min(state[row, 1] + weight, max(memory, weight))
                state[row, 0], state[row, 1] = square, known
                scale = np.float32(1.0) / (known + _FAINT)
            factor = scale * _load(gains, np.uintp(16 * block))
            _store(rows, place, _load(rows, place) - factor * gradient)
        for worker in range(workers):
            touched[worker, row] = 0


@njit(cache=True, parallel=True)
def total_variation(neighbours, first, last, values, width, weight, scale, gradient, touched):
    """Gradient of total variation (Shen et al. 2023, Eq. 3) on a run of rows, into worker 0's.

    Each row gathers its own gradient from the differences that it takes part in, so that no two
    threads write the same place.

    Parameters
    ----------
    neighbours
        int32 [rows, 6]: next along x, y, z, previous along x, y, z; empty ones give the row itself.
    first, last
        Range of rows.
    values
        float32 [rows * width], colours; what is no coefficient must be zero. Or float32
        [rows], densities: their gradient goes to the last value of each row.
    width
        Width of a row of the gradient, 16 or 32.
    weight
        Weight of the loss, divided by the number of rows in the range.
    scale
        Difference between neighbours is multiplied by this (resolution / 256).
    gradient
        float32 [rows * width], added to.
    touched
        uint8 [rows], set for the range.
    """
    factor = np.float32(scale)
    share = np.float32(weight) * factor
    colors = len(values) > len(touched)
    for row in prange(first, last):
        touched[row] = 1
        if not colors:
            gradient[row * width + width - 1] += share * _pull(neighbours, row, values, factor)
            continue
        for block in range(width // 16):
            place = np.uintp(row * width + 16 * block)
            slope = _pull_row(neighbours, row, values, width, 16 * block, factor)
            _store(gradient, place, _load(gradient, place) + share * slope)


@njit(cache=True)
def _length(ex, ey, ez):
    return np.sqrt(ex * ex + ey * ey + ez * ez + np.float32(1e-9))


@njit(cache=True)
def _differences(neighbours, row, values, scale):
    """Differences of a value to the next ones along x, y, z."""
    here = values[row]
    x, y, z = neighbours[row, 0], neighbours[row, 1], neighbours[row, 2]
    return (values[x] - here) * scale, (values[y] - here) * scale, (values[z] - here) * scale


@njit(cache=True)
def _pull(neighbours, row, values, scale):
    """Slope of the lengths of all differences that one value takes part in."""
    ex, ey, ez = _differences(neighbours, row, values, scale)
    slope = -(ex + ey + ez) / _length(ex, ey, ez)
    for axis in range(3):
        before = neighbours[row, 3 + axis]
        if before != row:
            ex, ey, ez = _differences(neighbours, before, values, scale)
            own = ex if axis == 0 else (ey if axis == 1 else ez)
            slope += own / _length(ex, ey, ez)
    return slope


@njit(cache=True)
def _row_differences(neighbours, row, values, width, start, scale):
    """The same for 16 values of a row from ``start`` on."""
    here = _load(values, np.uintp(row) * np.uintp(width) + np.uintp(start))
    return ((_load(values, np.uintp(neighbours[row, 0] * width + start)) - here) * scale,
            (_load(values, np.uintp(neighbours[row, 1] * width + start)) - here) * scale,
            (_load(values, np.uintp(neighbours[row, 2] * width + start)) - here) * scale)


@njit(cache=True)
def _pull_row(neighbours, row, values, width, start, scale):
    """`_pull` for 16 values of a row."""
    small = np.float32(1e-9)
    ex, ey, ez = _row_differences(neighbours, row, values, width, start, scale)
    slope = _floats(np.float32(0.0)) - (ex + ey + ez) / _sqrt(ex * ex + ey * ey + ez * ez + small)
    x, y, z = neighbours[row, 3], neighbours[row, 4], neighbours[row, 5]
    if x != row:
        ex, ey, ez = _row_differences(neighbours, x, values, width, start, scale)
        slope = slope + ex / _sqrt(ex * ex + ey * ey + ez * ez + small)
    if y != row:
        ex, ey, ez = _row_differences(neighbours, y, values, width, start, scale)
        slope = slope + ey / _sqrt(ex * ex + ey * ey + ez * ez + small)
    if z != row:
        ex, ey, ez = _row_differences(neighbours, z, values, width, start, scale)
        slope = slope + ez / _sqrt(ex * ex + ey * ey + ez * ez + small)
    return slope
