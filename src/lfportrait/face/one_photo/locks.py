"""Fine detail of long hair that no photo shows: what it shows of it, again and again.

On a chart of a head, around it and down it, long hair hangs down: strands are about upright. A row
of the chart is seen from somewhere beside the face to where the surface turns away. From there on
the detail of that part follows again, each piece faded into the next. Mirrored instead, waves would
meet as rings.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ...arrays import Float64

AXIS, HIGH, RADIUS = -0.25, 0.25, 0.5
"""Depth of the chart's axis; height from which on the chart is that of a ball; and its radius,
portrait units."""
CELL = 0.008  # Of the chart at least, portrait units.
SEEN = 0.3  # So well a cell is seen that counts.
GAP = 0.10  # Gaps that do not end what is seen of a row, radians.
BESIDE, BEHIND = 0.3, 0.1
"""A side of the chart begins so far beyond the middle of the face, and ends so far before that of
the back, radians."""
EVEN = 0.15  # Over so many rows the places up to which they are seen are even, portrait units.
NARROW, WIDEST, SHARE = (0.10, 0.35), 0.8, 30
"""What is seen is copied as far as it is wider than the first, and in full from the second on; no
more than the third of it; radians. So many percent of the rows may show less."""
FADE = 0.3  # How much of a piece goes over into the next.


class Chart(NamedTuple):
    """Detail on a chart [V, U], whose middle column is in front."""

    first: float  # Height of the first row.
    cell: float  # Portrait units.
    values: Float64  # float64 [V, U, C].
    # float64 [2, V] and [2]: up to where rows are seen, and how much, on both sides; radians.
    ends: Float64
    widths: Float64

    @staticmethod
    def of(points: Float64, values: Float64, weights: Float64, cell: float) -> Chart:
        """The chart of values [N, C] of places [N, 3] that are seen so well [N]."""
        around, down = _places(points)
        cell = max(cell, CELL)
        first = float(down.min()) - cell
        size = int((down.max() - first) / cell) + 3, round(2 * np.pi * RADIUS / cell)
        row = np.rint((down - first) / cell).astype(int)
        column = np.rint((around / (2 * np.pi) + 0.5) * size[1]).astype(int) % size[1]
        flat = row * size[1] + column
        count = np.bincount(flat, minlength=size[0] * size[1]).reshape(size).astype(np.float64)
        known = np.column_stack([weights[:, None] * values, weights])
        sums = np.stack([np.bincount(flat, one, count.size).reshape(size) for one in known.T])
        modes = ("nearest", "wrap")
        sure = sums[-1] / np.maximum(count, 1)
        near = ndimage.gaussian_filter(sums, (0.7, 0.7), mode=modes, axes=(1, 2))
        # Beside what is seen there is no detail, or little.
        wide = ndimage.gaussian_filter(sums, (8, 3), mode=modes, axes=(1, 2))
        share = np.clip(5 * near[-1], 0, 1)
        mean, around_it = (one[:-1] / np.maximum(one[-1], 1e-9) for one in (near, wide))
        # Mirrored, the middle column stays where it is.
        found = [_ends(one, cell) for one in (np.roll(sure[:, ::-1], 1, axis=1), sure)]
        return Chart(first, cell, np.moveaxis(share * mean + (1 - share) * around_it, 0, -1),
                     np.stack([end for end, _ in found]), np.array([width for _, width in found]))

    def at(self, points: Float64) -> tuple[Float64, Float64]:
        """Detail [N, C] of places [N, 3], and how much there is to copy [N]."""
        around, down = _places(points)
        row = np.clip((down - self.first) / self.cell, 0, len(self.values) - 1)
        right = around > 0
        ends = [ndimage.map_coordinates(one, [row], order=1, mode="nearest") for one in self.ends]
        end, width = np.where(right, ends[1], ends[0]), self.widths[right.astype(int)]
        begin, over = end - width, FADE * width
        away = begin + np.abs(np.abs(around) - begin)
        # What is seen is itself; a piece of it begins where it starts to go over into the next.
        own = away < end - over
        way = np.where(own, away - begin, np.mod(away - end + over, np.maximum(width - over, 1e-9)))
        last = np.where(own, 0.0, np.clip(1 - way / np.maximum(over, 1e-9), 0, 1))
        out = np.zeros((len(points), self.values.shape[-1]))
        for share, shift in ((1 - last, 0.0), (last, width - over)):
            column = 0.5 + np.where(right, 1, -1) * (begin + way + shift) / (2 * np.pi)
            at = [row, column * self.values.shape[1]]
            detail = np.stack([ndimage.map_coordinates(one, at, order=1, mode="grid-wrap")
                               for one in np.moveaxis(self.values, -1, 0)], axis=1)
            # Two that have nothing in common are as strong together as one.
            out += (share / np.hypot(last, 1 - last))[:, None] * detail
        return out, np.clip((width - NARROW[0]) / (NARROW[1] - NARROW[0]), 0, 1)


def _places(points: Float64) -> tuple[Float64, Float64]:
    """Where points [N, 3] lie around a head (radians, 0 in front), and how high on the chart."""
    x, y, z = points.T
    over = RADIUS * np.arctan2(np.maximum(y - HIGH, 0), np.hypot(x, z - AXIS))
    return np.arctan2(x, z - AXIS), np.minimum(y, HIGH) + over


def _ends(sure: Float64, cell: float) -> tuple[Float64, float]:
    """Up to where rows [V, U] are seen on the right of the chart, [V], and how much; radians."""
    rows, columns = sure.shape
    around = (np.arange(columns) / columns - 0.5) * 2 * np.pi
    seen = (sure > SEEN) & (around > -BESIDE) & (around < np.pi - BEHIND)
    gap = max(1, round(GAP * RADIUS / cell))
    known = np.flatnonzero(seen.sum(axis=1) > 1)
    if len(known) < 3:
        return np.zeros(rows), 0.0
    last, wide = np.zeros(len(known)), np.zeros(len(known))
    for k, row in enumerate(known):
        found = np.flatnonzero(seen[row])
        gaps = np.flatnonzero(np.diff(found) > gap)
        last[k] = around[found[-1]]
        wide[k] = last[k] - around[found[gaps[-1] + 1 if len(gaps) else 0]]
    end = np.interp(np.arange(rows), known, last)
    end = ndimage.median_filter(end, 2 * max(1, round(0.5 * EVEN / cell)) + 1, mode="nearest")
    return (ndimage.gaussian_filter1d(end, EVEN / cell, mode="nearest"),
            float(min(np.percentile(wide, SHARE), WIDEST)))
