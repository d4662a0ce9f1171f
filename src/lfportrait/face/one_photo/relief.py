"""Inflate outlines: half thicknesses of what a photo shows as flat.

The square q of the half thickness solves Poisson's equation with q = 0 on the outline (as in
Ink-and-Ray, Sykora et al. 2014): a disc becomes a ball, and every outline is met perpendicularly.
Where the surface is known, as along a hairline, q is given; where something lies within, it is a
lower bound.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from ...arrays import Bool, Float64

__all__ = ["inflated"]


def inflated(domain: Bool, inside: NDArray[np.floating], cell: float, *, source: float,
             given: Float64 | None = None, least: Float64 | None = None,
             free: Bool | None = None) -> Float64:
    """Squares of half thicknesses, float64 [h, w], in units of ``cell`` squared.

    Parameters
    ----------
    domain : bool [h, w], where to solve.
    inside : Signed distance from the outline in cells, which is known more finely than whole
        cells.
    cell : Width of a cell.
    source : The Laplacian is minus this: 4 makes a disc a ball, 2 a strip a tube.
    given : [h, w], values at places beside the domain, or within it, NaN elsewhere.
    least : [h, w], lower bounds.
    free : bool [h, w]: places beside the domain where it is merely cut off: no slope across
        them. All others beside it, without given values, are outline.

    Returns
    -------
    squares : Zero beside the domain.
    """
    known = np.full(domain.shape, np.nan) if given is None else given
    loose = np.zeros(domain.shape, bool) if free is None else free
    pinned = np.full(domain.shape, np.nan)
    pinned[domain] = known[domain]
    out = np.zeros(domain.shape)
    for _ in range(4 if least is not None else 1):
        out = _solved(domain, inside, cell, source, known, loose, pinned)
        if least is None:
            break
        low = domain & (out < least - 1e-12) & np.isnan(pinned)
        if not low.any():
            break
        pinned[low] = least[low]
    return out if least is None else np.where(domain, np.maximum(out, least), out)


def _solved(domain: Bool, inside: NDArray[np.floating], cell: float, source: float,
            known: Float64, loose: Bool, pinned: Float64) -> Float64:
    """The solution with some values held."""
    asked = domain & np.isnan(pinned)
    number = np.full(domain.shape, -1)
    count = int(asked.sum())
    number[asked] = np.arange(count)
    out = np.where(domain & ~asked, np.nan_to_num(pinned), 0.0)
    if not count:
        return out
    diagonal, right = np.zeros(count), np.full(count, source * cell ** 2)
    rows, columns = [], []
    row, column = np.nonzero(asked)
    height, width = domain.shape
    for down, across in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        other = row + down, column + across
        within = (other[0] >= 0) & (other[0] < height) & (other[1] >= 0) & (other[1] < width)
        at = np.clip(other[0], 0, height - 1), np.clip(other[1], 0, width - 1)
        linked = within & asked[at]
        rows.append(np.flatnonzero(linked))
        columns.append(number[at][linked])
        value = np.where(domain[at], pinned[at], known[at])
        held = within & ~asked[at] & np.isfinite(value)
        right[held] += value[held]
        outline = within & ~asked[at] & ~np.isfinite(value) & ~loose[at]
        one, two = inside[row, column], inside[at]
        share = np.clip(one / np.maximum(one - two, 1e-6), 0.15, 1.0)
        diagonal += np.where(linked | held, 1.0, np.where(outline, 1.0 / share, 0.0))
    link = sparse.coo_array((np.ones(sum(map(len, rows))),
                             (np.concatenate(rows), np.concatenate(columns))),
                            shape=(count, count))
    matrix = (sparse.diags_array(diagonal + 1e-9) - link).tocsc()
    found = linalg.splu(matrix, permc_spec="MMD_AT_PLUS_A",
                        options={"SymmetricMode": True}).solve(right)
    out[asked] = found
    return out
