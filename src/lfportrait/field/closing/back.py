"""Find where a head is open behind, and close it in the field."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float64
from ...capture import Camera, Capture
from ..geometry.chart import Chart, chart_of, coherent, normals_of, read_surface
from ..geometry.plate import continued, large_pieces, smoothed
from ..grid import VoxelField
from ..trimming import OPAQUE, Cut
from .photos import Photos, behind_what_is_seen
from .shell import Shell, with_shell

__all__ = ["Closed", "close_back", "shown_well"]

BEHIND = np.radians(75.0)
"""Angle from the front from which on gaps are closed."""
AROUND = 100.0
"""Photos all around a head are nowhere further apart, in degrees about the vertical axis."""
INSIDE = -0.3
"""Cosine between a chart's ray and the way to a photo below which that sees the other side."""
KNOWN = 0.3
"""Share of the chart that must be known for anything to be continued from it."""
LEAST = 0.005
"""Share of the surface that a gap has at least: an ear's shadow is none."""


@dataclass(frozen=True)
class Closed:
    """What `close_back` did.

    Attributes
    ----------
    share
        Share of the surface that was open.
    points
        Lattice points that are new.
    """

    share: float
    points: int


def close_back(field: VoxelField, landmarks: NDArray[np.floating], capture: Capture,
               cut: Cut | None = None) -> tuple[VoxelField, Closed | None]:
    """Close a field's surface where no photo shows it.

    Parameters
    ----------
    field
        Of a head, in the portrait frame, without a texture.
    landmarks
        [68, 3], iBUG order, of its face.
    capture
        The photos that it was reconstructed from, with mattes.
    cut
        What lies below is none of the head (`find_cut`).

    Returns
    -------
    field, closed
        The same field and None where nothing is open.
    """
    points = field.lattice_points()[field.density > OPAQUE]
    if cut is not None:
        points = points[cut.above(points) > 0]
    given = np.isfinite(landmarks)
    if not (given[[0, 16]].all() and given[17:27].any() and len(points) >= 1000) or _all_around(
            capture.cameras[capture.training()]):
        return field, None
    voxel = float(field.spacing.mean())
    chart = chart_of(points, voxel, landmarks)
    if chart is None:
        return field, None
    distance, colors = read_surface(field, chart, cut)
    photos = Photos(field, capture)
    known = np.isfinite(distance)
    # Outlines, seen along the surface, locate it; but no photo sees a face from inside.
    known[known] = photos.seen(chart.points(distance)[known], chart.rays[known], INSIDE) > 1
    known &= coherent(chart, np.where(known, distance, np.nan))
    # Crumbs in the gap are none of the surface around it.
    known = large_pieces(known, np.ones(known.shape), LEAST * known.size)
    if known.mean() < KNOWN:
        return field, None
    gap = ~known & (np.abs(chart.angle) > BEHIND)
    log = np.log(np.maximum(np.where(known, distance, 1.0), voxel))
    whole = np.exp(continued(log[..., None], known, bending=1.0)[..., 0])
    area = whole ** 2 * np.cos(chart.elevation)[:, None]
    gap = large_pieces(gap, area, LEAST * float(area.sum()))
    share = float((area * gap).sum() / area.sum())
    if not gap.any():
        return field, None
    whole = behind_what_is_seen(chart, whole, gap, photos)
    normal = normals_of(chart, smoothed(whole, np.ones_like(known), 1.0))
    cosine = np.maximum((normal * chart.rays).sum(axis=-1), 0.3)
    well = shown_well(chart, chart.points(distance), known, photos)
    # Hair, neck and collar lie above each other: colors come from the sides.
    paint = continued(smoothed(colors, well, 3.0), well, upwards=0.03)
    shell = Shell(chart, whole, cosine, np.clip(paint, 0, 1),
                  ndimage.binary_dilation(gap, np.ones((3, 3))), voxel)
    closed, count = with_shell(field, shell, photos, cut)
    return closed, Closed(share, count)


def shown_well(chart: Chart, points: Float64, known: Bool, photos: Photos) -> Bool:
    """The ``known`` cells [V, U] whose points [V, U, 3] enough photos see; all if none are."""
    well = known.copy()
    well[well] = photos.seen(points[well], chart.rays[well]) >= photos.enough
    return well if well.any() else known


def _all_around(cameras: Camera) -> bool:
    """Whether photos were taken from all sides."""
    angles = np.sort(np.degrees(np.arctan2(cameras.position[:, 0], cameras.position[:, 2])))
    return bool(np.diff(angles, append=angles[0] + 360.0).max() < AROUND)
