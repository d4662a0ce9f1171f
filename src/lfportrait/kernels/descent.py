"""One step down the gradient: RMSProp on the rows that rays touched, total variation on runs.

A lattice point's gradient is one row: its colour coefficients, and its density's in the last value.
Rows are 16 or 32 values wide and go through the lanes of `lfportrait.kernels.lanes`, 16 at a time.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from .lanes import LANES

__all__ = ["rmsprop", "total_variation"]

_floats, _where, _iota, _sqrt = LANES.floats, LANES.where, LANES.iota, LANES.sqrt
_load, _store, _lane = LANES.load, LANES.store, LANES.lane


@njit(cache=True, parallel=True)
def rmsprop(density, rows, width, gradients, touched, mean_square, rate_density, rate, decay,
            epsilon, lowest):
    """One RMSProp step on the rows that any worker touched; gradients and marks are set to zero.

    Parameters
    ----------
    density, rows
        float32 [N + 1] and [(N + 1) * width], the parameters; the last row stays as it is.
    width
        Row width, 16 or 32; a row's last value is the density's place and no parameter.
    gradients, touched
        float32 [workers, (N + 1) * width] and uint8 [workers, N + 1].
    mean_square
        float32 [(N + 1) * width], running mean squared gradient, density's in the last value.
    rate_density, rate, decay, epsilon
        Learning rates, decay of the running mean (0.95), floor of its root.
    lowest
        Densities are kept at or above this.
    """
    workers = len(gradients)
    rest = np.float32(1.0) - decay
    zero = np.float32(0.0)
    for row in prange(touched.shape[1] - 1):
        marks = 0
        for worker in range(workers):
            marks += np.int32(touched[worker, row])
        if marks == 0:
            continue
        for block in range(width // 16):
            place = np.uintp(row * width + 16 * block)
            gradient = _floats(zero)
            for worker in range(workers):
                if touched[worker, row] != 0:
                    own = gradients[worker]
                    gradient = gradient + _load(own, place)
                    _store(own, place, _floats(zero))
            square = decay * _load(mean_square, place) + rest * gradient * gradient
            _store(mean_square, place, square)
            change = rate * gradient / (_sqrt(square) + epsilon)
            if 16 * block + 16 == width:
                # The last value of a row is the density's gradient.
                slope = _lane(gradient, 15)
                scale = np.sqrt(mean_square[row * width + width - 1]) + epsilon
                density[row] = max(density[row] - rate_density * slope / scale, lowest)
                change = _where(_iota() == np.int32(15), _floats(zero), change)
            _store(rows, place, _load(rows, place) - change)
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
        float32 [rows * width], colours; their last values of a row must be zero. Or float32
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
