"""Inflated pieces of a picture, of which a person's solid is made.

The square q of a piece's half thickness solves Poisson's equation with q = 0 on the outline (as in
Ink-and-Ray, Sykora et al. 2014): a disc becomes a ball, and every outline is met perpendicularly.
Where the surface is known, as along a hairline, q is given; where something lies within, it is a
lower bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import linalg

from ...arrays import Bool, Float64
from .parts import Parts

METRES = 0.207  # Of a unit of the portrait frame.
EDGE = 4
"""Cells beyond its part of the picture in which a surface may be a piece's: it is that thick."""
BESIDE = 1.5  # Cells beyond its part of the picture up to which a piece goes on.
BROAD = 16.0  # Cells by which maps are blurred at most before they are halved.


@dataclass(frozen=True)
class Piece:
    """An inflated piece of the picture."""

    # front, back: float64 [h, w], squares of its half thicknesses; negative outside.
    front: Float64
    back: Float64
    middle: Float64  # float64 [h, w], depth.
    # ahead, behind: bool [h, w], where it lies before the middle and behind it; None: wherever its
    # squares are positive. Elsewhere the squares only lead its surface out of sight.
    ahead: Bool | None = None
    behind: Bool | None = None

    def covers(self, places: Float64, depth: Float64) -> Bool:
        """Whether points may belong to it, [N]: by their places, with `EDGE` cells around."""
        if self.ahead is None or self.behind is None:
            return np.ones(len(depth), bool)
        size = np.array(self.middle.shape)[:, None] - 1
        row, column = np.clip(np.rint(places), 0, size).astype(int)
        ahead, behind = (ndimage.binary_dilation(part, np.ones((2 * EDGE + 1,) * 2))
                         for part in (self.ahead, self.behind))
        return np.asarray(np.where(depth < self.middle[row, column], ahead[row, column],
                                   behind[row, column]))

    def distance(self, parts: Parts, places: Float64, depth: Float64) -> Float64:
        """About how far points lie outside, [N], portrait units."""
        out = np.full(len(depth), np.inf)
        rows, columns = self.front.shape
        within = ((places > 2) & (places < np.array([[rows - 3], [columns - 3]]))).all(axis=0)
        at, z = places[:, within], depth[within]
        away = z - Parts.at(self.middle, at)
        ahead = away < 0
        value, slope = np.empty(len(z)), np.zeros((len(z), 2))
        for side, squares in ((ahead, self.front), (~ahead, self.back)):
            value[side] = Parts.at(squares, at[:, side])
            for k, part in enumerate(np.gradient(squares)):
                slope[side, k] = Parts.at(part, at[:, side]) / parts.cell
        value = value - away ** 2
        length = np.sqrt((slope ** 2).sum(axis=1) + 4 * away ** 2)
        found = -value / np.maximum(length, 0.02)
        # It would else fill what lies beside it, as the space behind an ear.
        beyond: Float64 | None = None
        for side, part in ((ahead, self.ahead), (~ahead, self.behind)):
            if part is not None:
                if beyond is None or part is not self.ahead:
                    beyond = np.asarray(ndimage.distance_transform_edt(~part) - BESIDE)
                found[side] = np.maximum(found[side],
                                         Parts.at(beyond, at[:, side]) * parts.cell)
        out[within] = found
        return out


def filled(values: Float64, sigma: float) -> Float64:
    """A map [h, w] with its unknown (NaN) places filled smoothly from those around them."""
    done = np.isfinite(values)
    # What is known, and how much is: the wider they are blurred, the fewer cells they need.
    sums = np.dstack([np.where(done, values, 0.0), done.astype(np.float64)])
    result, size, scale = values.copy(), values.shape[::-1], 1
    while not done.all() and sigma < 4 * max(size):
        wide = cv2.GaussianBlur(sums, (0, 0), sigma / scale)
        if scale > 1:
            wide = cv2.resize(wide, size, interpolation=cv2.INTER_LINEAR)
        fresh = ~done & (wide[..., 1] > 1e-3)
        result[fresh] = wide[fresh, 0] / wide[fresh, 1]
        done = done | fresh
        sigma *= 2
        if sigma > BROAD * scale and min(sums.shape[:2]) > 1:
            sums = cv2.resize(sums, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            scale *= 2
    result[~done] = np.nanmean(values)
    return np.asarray(result)


def outside(squares: Float64, parts: Parts, domain: Bool, dip: float) -> Float64:
    """Squares [H, W] continued beyond their domain, so that their slopes stay a surface's.

    Outside of the person they are negative, as steep as within: those of the place's mirror image
    across the outline. Elsewhere the half thickness goes on, less by ``dip`` times the way.
    """
    distance, nearest = ndimage.distance_transform_edt(~domain, return_indices=True)
    thick = np.sqrt(np.maximum(squares, 0))[tuple(nearest)] - dip * distance * parts.cell
    out = np.where(domain, squares, np.sign(thick) * thick ** 2)
    row, column = np.mgrid[:squares.shape[0], :squares.shape[1]].astype(np.float32)
    outline = parts.inside
    down, across = np.gradient(outline)
    length = np.maximum(np.hypot(down, across), 0.3)
    way = np.minimum(-2 * outline, 40.0)
    x, y = column + across / length * way, row + down / length * way
    mirrored = cv2.remap(out.astype(np.float32), x.astype(np.float32), y.astype(np.float32),
                         cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    beyond = ~domain & (outline <= 0)
    out[beyond] = np.minimum(-np.abs(mirrored[beyond]), -1e-7)
    return np.asarray(out, np.float64)


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
