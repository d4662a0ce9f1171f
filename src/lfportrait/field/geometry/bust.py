"""A generic bust: the size and shape that heads, necks and shoulders usually have.

Where no photo shows a side of a head, usual proportions are better than nothing. The bust is a
stack of superellipses, one a height, with an ellipsoid above the brows, in the portrait frame,
whose unit is 1.8 times the height from the eyes to the chin (about 0.21 m). The sizes are those of
an average adult (head 0.155 m wide, 0.197 m long; neck 0.38 m around; shoulders 0.48 m). It is only
ever scaled, place by place, to what the photos show.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Float64
from .chart import Chart

__all__ = ["BROWS", "CHIN", "LOWEST", "bust_chart", "bust_distance"]

BROWS = 0.10
"""Height of the brows: above it lies the skull's ellipsoid."""
CHIN = -0.60
"""Height of the chin's lowest point."""
LOWEST = -1.8
"""Height at which the bust ends."""

_SECTIONS = np.array([
    # height, half width, front, back
    (-1.80, 1.15, 0.36, -0.66),
    (-1.40, 1.15, 0.30, -0.66),
    (-1.15, 1.08, 0.20, -0.64),
    (-1.00, 0.92, 0.10, -0.60),
    (-0.90, 0.66, 0.06, -0.54),
    (-0.80, 0.42, 0.08, -0.47),
    (-0.70, 0.30, 0.16, -0.43),
    (-0.60, 0.29, 0.38, -0.42),
    (-0.56, 0.29, 0.47, -0.42),
    (-0.50, 0.31, 0.50, -0.42),
    (-0.35, 0.35, 0.51, -0.46),
    (-0.20, 0.38, 0.49, -0.51),
    (0.00, 0.39, 0.44, -0.54),
    (0.10, 0.39, 0.46, -0.54),
])
_CROWN = 0.57
"""Height of the crown."""
_ROUND, _SQUARE = 2.0, 2.6
"""Exponents of the superellipses of a head and of a chest."""


def bust_chart(cell: float, middle: float = 0.0, frame: Float64 | None = None,
               lowest: float = LOWEST) -> Chart:
    """Rays around the middle of the bust (`Chart`).

    Parameters
    ----------
    cell
        Distance of rows, portrait units.
    middle
        x of the face's middle in the portrait frame.
    frame
        float64 [4, 4], similarity from the world to the portrait frame.
    lowest
        Height of the lowest row.
    """
    heights = np.arange(lowest, BROWS, cell)
    heights += BROWS - heights[-1]
    radius = float(_SECTIONS[-1, 1])
    above = np.arange(1, int(0.5 * np.pi * radius / cell)) * cell / radius
    # A shelf such as a chin must not move the axis forwards and back again.
    depth = np.interp(heights, (-1.2, -0.8, -0.3, BROWS), (-0.22, -0.18, -0.07, -0.04))
    axis = np.stack([np.full(len(heights), middle), heights, depth], axis=1)
    columns = int(2 * np.pi * 0.45 / cell)
    return Chart(np.concatenate([axis, np.repeat(axis[-1:], len(above), axis=0)]),
                 np.concatenate([np.zeros(len(heights)), above]),
                 (np.arange(columns) + 0.5) / columns * 2 * np.pi - np.pi, cell, len(heights),
                 frame)


def bust_distance(chart: Chart, chin: float = CHIN) -> Float64:
    """Distances of the generic bust's surface along a chart's rays, world units, float64 [V, U].

    ``chin`` is the height of the lowest point of the face: all below is moved up or down with it.
    """
    rays = replace(chart, frame=None).rays
    height = chart.axis[:, 1] + np.interp(chart.axis[:, 1], (chin, -0.2), (CHIN - chin, 0.0))
    half, front, back = (np.interp(height, _SECTIONS[:, 0], _SECTIONS[:, k])[:, None]
                         for k in (1, 2, 3))
    depth = chart.axis[:, 2][:, None]
    along = np.where(rays[..., 2] > 0, front - depth, depth - back)
    power = np.interp(height, (-1.1, -0.8), (_SQUARE, _ROUND))[:, None]
    up = np.maximum(rays[..., 1] / (_CROWN - BROWS), 0.0)
    return np.asarray((np.abs(rays[..., 0] / half) ** power + np.abs(rays[..., 2] / along) ** power
                       + up ** power) ** (-1.0 / power) / chart.scale, np.float64)
