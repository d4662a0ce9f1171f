"""A head that was fitted to a capture, as a closing uses it: distances of its skull, and its ears.

What photos show bends it (`sides`); where they show nothing, its skull, jaw and neck go on. Its
ears stand out from what a chart can hold (`lfportrait.field.geometry.chart`): they are solids of
their own (`ears`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..geometry.chart import Chart
from ..geometry.plate import fitted_plate

__all__ = ["FitHead", "FittedHead", "head_distance", "mesh_samples"]

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

STEP = 0.006
"""Distance of a mesh's samples, portrait units."""
FACING = 0.2
"""Cosine between a chart's ray and a surface from which on that surface is what the ray meets."""
LAYER = 0.04
"""Surfaces further within than this, portrait units, are others, which the first hides."""

GIVES_WAY = 1e-3
"""Pull towards what lies around where a head has no surface: in some five cells it is reached."""


@dataclass(frozen=True)
class FittedHead:
    """A mesh in the portrait frame.

    Attributes
    ----------
    points
        float64 [N, 3].
    triangles
        int32 [T, 3], counter-clockwise seen from outside.
    ears
        bool [N], which of the points are the ears'.
    """

    points: Float64
    triangles: NDArray[np.int32]
    ears: Bools


FitHead = Callable[[Float64, Float64, Float64, Float64], FittedHead | None]
"""Fits a head to landmarks [68, 3] and to places of a surface, [N, 3], with their outward unit
normals [N, 3] and how far each is to be trusted [N], 0 to 1; all in the portrait frame. None where
there is no model of heads."""


def mesh_samples(points: Float64, triangles: NDArray[np.int32], step: float = STEP,
                 ) -> tuple[Float64, Float64, NDArray[np.int64]]:
    """Places on a mesh about ``step`` apart.

    Returns
    -------
    places, normals, triangle
        float64 [S, 3] each, the normals outwards and of unit length, those of the triangles; and
        the triangle of each, [S].
    """
    corners = points[triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.clip(np.ceil(sides / step), 1, 24).astype(int)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    places: list[Float64] = []
    owner = []
    for count in np.unique(steps):
        chosen = np.flatnonzero(steps == count)
        first, second = (part.ravel() for part in np.mgrid[:count, :count])
        low = first + second < count
        # The middles of the small triangles that stand upright.
        share = np.stack([first[low] + 1 / 3, second[low] + 1 / 3], axis=1) / count
        weights = np.column_stack([1 - share.sum(axis=1), share])
        places.append(np.einsum("sk,tki->tsi", weights, corners[chosen]).reshape(-1, 3))
        owner.append(np.repeat(chosen, len(weights)))
    triangle = np.concatenate(owner)
    return np.concatenate(places), normal[triangle], triangle


def head_distance(head: FittedHead, chart: Chart, around: Float64) -> Float64:
    """Distances of a head without its ears along a chart's rays, float64 [V, U], world units.

    Parameters
    ----------
    head
        In the frame of the chart.
    around
        Distances [V, U] to go over into where the head has no surface, below its neck.
    """
    places, normals, triangle = mesh_samples(head.points, head.triangles)
    ear = np.asarray(head.ears[head.triangles].any(axis=1))
    skull = ~ear[triangle]
    row, column, away = _cells(chart, places)
    rays = np.asarray(_local_rays(chart)[np.clip(row, 0, len(chart.axis) - 1), column])
    chosen = skull & (row >= 0) & (row < len(chart.axis)) & ((rays * normals).sum(axis=1) > FACING)
    cell, away = (row * len(chart.angle) + column)[chosen], away[chosen]
    first = np.full(around.size, -np.inf)
    np.maximum.at(first, cell, away)
    layer = away > first[cell] - LAYER / chart.scale
    count = np.bincount(cell[layer], minlength=around.size)
    total = np.bincount(cell[layer], away[layer], around.size)
    found = (total / np.maximum(count, 1)).reshape(around.shape)
    known = (count > 0).reshape(around.shape)
    # The mesh ends raggedly: its last rows are left out.
    known &= ndimage.binary_erosion(known, np.ones((5, 1)), border_value=1)
    if not known.any():
        return around
    ratio = np.log(np.where(known, found, around) / around)
    return np.asarray(around * np.exp(fitted_plate(
        ratio, np.where(known, 1.0, 0.0), 0.5, 0.01, GIVES_WAY)), np.float64)


def _cells(chart: Chart, places: Float64,
           ) -> tuple[NDArray[np.int64], NDArray[np.int64], Float64]:
    """Row, column and distance in world units of places [N, 3] in the chart's frame, [N] each."""
    world = places
    if chart.frame is not None:
        world = (places - chart.frame[:3, 3]) @ np.linalg.inv(chart.frame[:3, :3]).T
    at, away = chart.places(world)
    row, column = np.rint(at).astype(np.int64)
    return row, column % len(chart.angle), away


def _local_rays(chart: Chart) -> Float64:
    """The chart's rays in its own frame, [V, U, 3]."""
    if chart.frame is None:
        return chart.rays
    return np.asarray(chart.rays @ chart.frame[:3, :3].T / chart.scale, np.float64)
