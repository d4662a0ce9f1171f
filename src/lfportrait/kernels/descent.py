"""One step down the gradient: RMSProp on the rows that rays touched, total variation on runs.

A lattice point's gradient is one row: its colour coefficients, and its density's in the last value.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

__all__ = ["rmsprop", "total_variation"]


@njit(cache=True, parallel=True)
def rmsprop(density, rows, width, used, gradients, touched, mean_square, rate_density, rate, decay,
            epsilon, lowest):
    """One RMSProp step on the rows that any worker touched; gradients and marks are set to zero.

    Parameters
    ----------
    density, rows
        float32 [N + 1] and [(N + 1) * width], the parameters; the last row stays as it is.
    width, used
        Row width, and how many of its values are parameters; the last value is the density's place.
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
    for row in prange(touched.shape[1] - 1):
        marks = 0
        for worker in range(workers):
            marks += np.int32(touched[worker, row])
        if marks == 0:
            continue
        start = row * width
        for worker in range(1, workers):
            if touched[worker, row] != 0:
                for i in range(start, start + width):
                    gradients[0, i] += gradients[worker, i]
                    gradients[worker, i] = np.float32(0.0)
                touched[worker, row] = 0
        touched[0, row] = 0
        for i in range(start, start + used):
            gradient = gradients[0, i]
            gradients[0, i] = np.float32(0.0)
            square = decay * mean_square[i] + rest * gradient * gradient
            mean_square[i] = square
            rows[i] -= rate * gradient / (np.sqrt(square) + epsilon)
        last = start + width - 1
        gradient = gradients[0, last]
        gradients[0, last] = np.float32(0.0)
        square = decay * mean_square[last] + rest * gradient * gradient
        mean_square[last] = square
        value = density[row] - rate_density * gradient / (np.sqrt(square) + epsilon)
        density[row] = max(value, lowest)


@njit(cache=True, parallel=True)
def total_variation(neighbours, first, last, values, stride, used, weight, scale, gradient, width,
                    slot, touched):
    """Gradient of total variation (Shen et al. 2023, Eq. 3) on a run of rows, into worker 0's.

    Each row gathers its own gradient from the differences that it takes part in, so that no two
    threads write the same place.

    Parameters
    ----------
    neighbours
        int32 [rows, 6]: next along x, y, z, previous along x, y, z; empty ones give the row itself.
    first, last
        Range of rows.
    values, stride, used
        float32, ``used`` values at the start of every ``stride``.
    weight
        Weight of the loss, divided by the number of rows in the range.
    scale
        Difference between neighbours is multiplied by this (resolution / 256).
    gradient, width, slot
        float32 [rows * width], added to from value ``slot`` of a row on.
    touched
        uint8 [rows], set for the range.
    """
    small = np.float32(1e-9)
    for row in prange(first, last):
        touched[row] = 1
        for i in range(used):
            here = values[row * stride + i]
            ex = (values[neighbours[row, 0] * stride + i] - here) * scale
            ey = (values[neighbours[row, 1] * stride + i] - here) * scale
            ez = (values[neighbours[row, 2] * stride + i] - here) * scale
            slope = -(ex + ey + ez) / np.sqrt(ex * ex + ey * ey + ez * ez + small)
            for axis in range(3):
                before = neighbours[row, 3 + axis]
                if before != row:
                    there = values[before * stride + i]
                    ax = (values[neighbours[before, 0] * stride + i] - there) * scale
                    ay = (values[neighbours[before, 1] * stride + i] - there) * scale
                    az = (values[neighbours[before, 2] * stride + i] - there) * scale
                    own = ax if axis == 0 else (ay if axis == 1 else az)
                    slope += own / np.sqrt(ax * ax + ay * ay + az * az + small)
            gradient[row * width + slot + i] += weight * scale * slope
