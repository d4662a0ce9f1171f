"""The light on what no photo shows, and its hue, by what a photo shows of the same material.

A cheek that is seen too slanted has the color of what lies around it, but not its light: below a
jaw a neck is darker, and what turns away from the light, too. How the logarithm of a photo's
colors goes with the normal of a place, and with how open it lies, is found by least squares where
the photo shows that material. Its colors are spread without that light, and then lit again. Skin
keeps to the hue that it has at each lightness where the photo sees it squarely: a rim of light
along one cheek, or a sleeve's reflection, would be a stain on the other.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ...arrays import Float64
from ...color import LUMINANCE

CELL = 0.02  # Of the lattice that a solid is blurred on at least, portrait units.
COARSEST = 0.025  # Lattices whose points are further apart tell too little of bends.
WIDTHS = (0.05, 0.12)
"""Standard deviations of means of what is around a place, and how far before it they are taken,
portrait units."""
FLAT = 0.1587  # Of such a mean, before a flat surface: beyond one deviation.
HIDDEN, OPEN = 0.05, 1.3  # The least and the most open that a place is taken for.
DARKEST = 0.02  # Added to colors before their logarithm.
TIE = 0.02  # Of coefficients to zero; variances of normals are some tenths.
FEWEST = 100  # So few places say nothing of a hue.
SHARES = (0.02, 0.15, 0.3, 0.5, 0.7, 0.85, 0.98)
"""Quantiles of the lightness that is seen between which hues are known."""
EVEN = 0.03  # A hue's least deviation, of a logarithm.
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


class Hue(NamedTuple):
    """Which hue a material has at each lightness, and by how much it varies."""

    light: Float64  # float64 [K], logarithms of lightness, rising.
    middle: Float64  # float64 [K, 2], of red and blue over green.
    spread: Float64  # float64 [K, 2], deviations.

    @staticmethod
    def of(colors: Float64, weights: Float64) -> Hue | None:
        """The one of colors [N, 3] that are known so well; None if these are too few."""
        some = weights > 0.5 * weights.max(initial=0.0)
        if some.sum() < FEWEST:
            return None
        light, hue = _hues(colors[some])
        steps = np.quantile(light, SHARES)
        found = []
        for low, high in itertools.pairwise(steps):
            part = (light >= low) & (light <= high)
            middle = np.median(hue[part], axis=0)
            away = 1.48 * np.median(np.abs(hue[part] - middle), axis=0)
            found.append((np.median(light[part]), middle, np.hypot(away, EVEN)))
        lights, middles, spreads = (np.array(one) for one in zip(*found, strict=True))
        return Hue(lights, middles, spreads)

    def held(self, colors: Float64) -> Float64:
        """Colors [N, 3] whose hue is near that of their lightness, which stays as it is."""
        light, hue = _hues(colors)
        middle, spread = (np.stack([np.interp(light, self.light, one[:, k]) for k in range(2)],
                                   axis=1) for one in (self.middle, self.spread))
        away = (hue - middle) / spread
        hue = middle + spread * away * (1 + away ** 4) ** -0.25
        out = np.exp(np.stack([hue[:, 0], np.zeros(len(hue)), hue[:, 1]], axis=1))
        return np.asarray(out * (np.exp(light) / (out @ LUMINANCE))[:, None] - DARKEST)


def _hues(colors: Float64) -> tuple[Float64, Float64]:
    """Logarithms of lightness [N] of colors [N, 3], and of red and blue over green [N, 2]."""
    colors = np.maximum(colors, 0) + DARKEST
    logs = np.log(colors)
    return np.log(colors @ LUMINANCE), np.stack([logs[:, 0] - logs[:, 1], logs[:, 2] - logs[:, 1]],
                                                axis=1)
