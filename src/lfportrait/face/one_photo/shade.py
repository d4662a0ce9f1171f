"""The light on what no photo shows, by what a photo shows of the same material.

A cheek that is seen too slanted has the color of what lies around it, but not its light: below a
jaw a neck is darker, and what turns away from the light, too. How the logarithm of a photo's
colors goes with the normal of a place, and with how open it lies, is found by least squares where
the photo shows that material. Its colors are spread without that light, and then lit again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ...arrays import Float64

CELL = 0.02  # Of the lattice that a solid is blurred on at least, portrait units.
COARSEST = 0.025  # Lattices whose points are further apart tell too little of bends.
WIDTHS = (0.05, 0.12)
"""Standard deviations of means of what is around a place, and how far before it they are taken,
portrait units."""
FLAT = 0.1587  # Of such a mean, before a flat surface: beyond one deviation.
HIDDEN, OPEN = 0.05, 1.3  # The least and the most open that a place is taken for.
DARKEST = 0.02  # Added to colors before their logarithm.
TIE = 0.02  # Of coefficients to zero; variances of normals are some tenths.
BETWEEN = 0.02, 0.98  # Quantiles of the light that is seen: no place has more of it, or less.


def open_around(points: Float64, normals: Float64, away: Float64, voxel: float) -> Float64:
    """How much of what lies before a surface is free, [N]: 1 before a flat one, less in a bend.

    1 everywhere if points are further apart than `COARSEST`.

    Parameters
    ----------
    points, normals : float64 [N, 3], of a shell around the surface, outwards.
    away : float64 [N], how far the points lie outside.
    voxel : How far apart they are.
    """
    if voxel > COARSEST:
        return np.ones(len(points))
    cell = max(CELL, 1.25 * voxel)  # every cell of the shell holds a point, or it would have holes
    margin = round(3 * max(WIDTHS) / cell)
    first = points.min(axis=0) - margin * cell
    cells = np.rint((points - first) / cell).astype(int)
    size = cells.max(axis=0) + margin + 1
    flat = np.ravel_multi_index(tuple(cells.T), tuple(size))
    count = np.bincount(flat, minlength=int(size.prod())).reshape(size)
    inside = np.bincount(flat, away < 0, int(size.prod())).reshape(size)
    share = inside / np.maximum(count, 1)
    share[ndimage.binary_fill_holes(share > 0.5) & (count == 0)] = 1.0  # below the shell
    on, out = points - away[:, None] * normals, np.ones(len(points))
    for width in WIDTHS:
        blurred = ndimage.gaussian_filter(np.asarray(share, np.float32), width / cell, truncate=3.0)
        at = (on + width * normals - first) / cell
        found = ndimage.map_coordinates(blurred, at.T, order=1, mode="nearest")
        out *= np.clip((1 - found) / (1 - FLAT), HIDDEN, OPEN) ** (1 / len(WIDTHS))
    return out


class Light(NamedTuple):
    """How the logarithm of colors goes with normals, and with that of how open places lie."""

    coefficients: Float64  # float64 [4, 3].
    low: Float64  # float64 [3], the least logarithm of a light, and the most.
    high: Float64

    @staticmethod
    def of(normals: Float64, free: Float64, colors: Float64, weights: Float64) -> Light:
        """The light on places [N] that a photo shows so well in such colors [N, 3]."""
        share = weights / max(float(weights.sum()), 1e-9)
        given, found = _features(normals, free), np.log(np.maximum(colors, 0) + DARKEST)
        features, found = given - share @ given, found - share @ found
        moments = (share[:, None] * features).T @ features + TIE * np.eye(features.shape[1])
        out = np.linalg.solve(moments, (share[:, None] * features).T @ found)
        out[-1] = np.maximum(out[-1], 0)  # no place is brighter as it lies deeper
        seen = given[weights > 0.5 * weights.max()] @ out
        low, high = np.quantile(seen, BETWEEN, axis=0)
        return Light(np.asarray(out, np.float64), low, high)

    def at(self, normals: Float64, free: Float64) -> Float64:
        """Factors [N, 3] of colors at places."""
        return np.asarray(np.exp(np.clip(_features(normals, free) @ self.coefficients,
                                         self.low, self.high)))


def _features(normals: Float64, free: Float64) -> Float64:
    return np.column_stack([normals, np.log(free)])
