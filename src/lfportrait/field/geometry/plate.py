"""Extrapolate a chart's unknown values; columns are periodic, rows are not."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.linalg import solveh_banded
from scipy.sparse import linalg

__all__ = ["continued", "fitted_plate", "large_pieces", "roughly_fitted_plate", "smoothed"]

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

TENSION = 0.02
"""Weight of the slope against the bending, in cells."""

LEAK = 0.003
"""How strongly a membrane holds together across a border, over elsewhere."""


def smoothed(values: Float64, known: Bools, width: float) -> Float64:
    """Values [V, U, ...] blurred, of the known ones alone."""
    sigma = (width, width, *(0,) * (values.ndim - 2))
    mode = ("nearest", "wrap", *("nearest",) * (values.ndim - 2))
    mask = known.astype(np.float64).reshape(*known.shape, *(1,) * (values.ndim - 2))
    total = ndimage.gaussian_filter(np.where(mask > 0, values, 0.0), sigma, mode=mode)
    weight = ndimage.gaussian_filter(mask, sigma, mode=mode)
    return np.asarray(total / np.maximum(weight, 1e-9), np.float64)


def large_pieces(cells: Bools, area: Float64, least: float) -> Bools:
    """The cells, [V, U], of pieces with an area of ``least`` or more; columns go around."""
    pieces, count = ndimage.label(np.tile(cells, 2), np.ones((3, 3), np.int8))
    sizes = ndimage.sum_labels(np.tile(area, 2), pieces, np.arange(count + 1))
    sizes[0] = 0.0
    large = (sizes >= least)[pieces]
    half = cells.shape[1]
    return np.asarray(large[:, :half] | large[:, half:])


def _operators(shape: tuple[int, int]) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Second differences [N, N] and first differences [2 N, N] of a chart of N cells."""
    def differences(n: int, wraps: bool) -> tuple[sparse.csr_array, sparse.csr_array]:
        first = sparse.diags_array([-np.ones(n), np.ones(n - 1)], offsets=[0, 1]).tolil()
        if wraps:
            first[n - 1, 0] = 1.0
        else:
            first[n - 1, n - 1] = 0.0
        first = first.tocsr()
        return first, -(first.T @ first)

    rows, columns = shape
    (up, bend_up), (on, bend_on) = differences(rows, False), differences(columns, True)
    one, all_around = sparse.eye_array(rows), sparse.eye_array(columns)
    return ((sparse.kron(bend_up, all_around) + sparse.kron(one, bend_on)).tocsr(),
            sparse.vstack([sparse.kron(up, all_around), sparse.kron(one, on)]).tocsr())


def continued(values: Float64, known: Bools, *, bending: float = 0.0,
              upwards: Float64 | float = 1.0, apart: Bools | None = None) -> Float64:
    """Values [V, U, C] with the unknown ones solved for: a plate under tension, or a membrane.

    Parameters
    ----------
    values, known
        float64 [V, U, C], bool [V, U]; some cells are known.
    bending
        Weight of bending; 0: a membrane (Laplace's equation).
    upwards
        How strongly a membrane holds together across rows, over along them; one for all rows, or
        one a row, [V].
    apart
        bool [V, U]: across the border of these cells next to nothing of a membrane holds together.
    """
    bend, slope = _operators((known.shape[0], known.shape[1]))
    across = np.broadcast_to(np.reshape(upwards, (-1, 1)), known.shape)
    weights = np.concatenate([across.ravel(), np.ones(known.size)])
    if apart is not None:
        weights[np.abs(slope @ apart.ravel().astype(np.float64)) > 0] *= LEAK
    matrix = slope.T @ (sparse.diags_array(weights) @ slope)
    if bending > 0:
        matrix = bending * (bend.T @ bend) + TENSION ** 2 * matrix
    matrix = matrix.tocsr()
    free = np.flatnonzero(~known.ravel())
    if not len(free):
        return values
    flat = np.where(known[..., None], values, 0.0).reshape(known.size, -1)
    right = -(matrix[free] @ flat)
    solve = linalg.splu(matrix[free][:, free].tocsc())
    flat[free] = solve.solve(np.ascontiguousarray(right))
    return flat.reshape(values.shape)


def fitted_plate(values: Float64, weights: Float64, bending: float, slope: float,
                 tension: Float64 | float) -> Float64:
    """A plate near values [V, U] by their weights, which bends and slopes as little as it can.

    Minimises sum weights (u - values)^2 + bending |bend u|^2 + slope |slope u|^2 + tension u^2, by
    Cholesky's decomposition of a band: half of the time of one in nested dissection.

    Parameters
    ----------
    values, weights
        float64 [V, U]; weights of 0 leave a cell free.
    bending, slope
        Weights of second and first differences.
    tension
        Pull towards zero: one for all cells, or one a row, [V, 1].
    """
    bend, first = _operators((values.shape[0], values.shape[1]))
    matrix = (sparse.diags_array((weights + tension).ravel()) + bending * (bend.T @ bend)
              + slope * (first.T @ first))
    # Row after row the matrix is a narrow band: two rows, in both directions.
    upper = sparse.triu(matrix).tocoo()
    above = upper.col - upper.row
    band = np.zeros((above.max() + 1, values.size))
    band[above.max() - above, upper.col] = upper.data
    plate = solveh_banded(band, (weights * values).ravel(), overwrite_ab=True, check_finite=False)
    return np.asarray(plate, np.float64).reshape(values.shape)


def roughly_fitted_plate(values: Float64, weights: Float64, bending: float, slope: float,
                         tension: Float64 | float) -> Float64:
    """`fitted_plate` by blocks of 2x2 cells, interpolated between them: an eighth of the time.

    A block bends by four times as much as its cells and there are a quarter as many of them, so
    that the same plate has a quarter of the bending weight and the same weight of the slope.
    """
    rows, columns = values.shape
    if columns % 2:
        return fitted_plate(values, weights, bending, slope, tension)

    def blocks(cells: Float64) -> Float64:
        padded = np.pad(cells, ((0, rows % 2), (0, 0)))
        return np.asarray(padded.reshape(-1, 2, columns // 2, 2).sum(axis=(1, 3)), np.float64)

    total = blocks(weights)
    mean = blocks(weights * values) / np.maximum(total, 1e-12)
    pull = blocks(np.broadcast_to(np.asarray(tension, np.float64), values.shape))
    plate = fitted_plate(mean, total, 0.25 * bending, slope, pull)
    wrapped = np.pad(plate, ((0, 0), (1, 1)), mode="wrap")
    fine = cv2.resize(wrapped, (2 * wrapped.shape[1], 2 * wrapped.shape[0]),
                      interpolation=cv2.INTER_LINEAR)
    return np.asarray(fine[:rows, 2:-2], np.float64)
