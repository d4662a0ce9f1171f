"""The sides and back of a head that an arc of photos does not show, after a surface that was found.

Where photos look along the surface or do not see it at all, what was trained there is what little
the outlines left over: fringes, haze, holes. There the surface that the field started from
(`lfportrait.field.geometry.head_surface`) takes its place, bent to the trained one where that
begins, in the colors around it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...capture import Capture
from ..geometry.chart import coherent, normals_of, read_surface
from ..geometry.head_surface import HeadSurface
from ..geometry.plate import fitted_plate, large_pieces, smoothed
from ..grid import VoxelField
from ..trimming import Cut
from .back import Closed, shown_well
from .colors import continued_colors
from .hairline import NAPE, hair_cells
from .photos import Photos, behind_what_is_seen
from .shell import Shell, with_shell

__all__ = ["close_sides"]

Float64 = NDArray[np.float64]

SQUARE = 0.05
"""Cosine between normal and way to the cameras from which on photos see a surface well."""
RIM = 0.3
"""Weight of a surface that photos look along, over one that they see well."""
APART = 0.08
"""A trained surface further than this from the one it started from is another thing."""
LEAST = 0.003
"""Share of the chart that a piece has at least, seen or not."""


def close_sides(field: VoxelField, surface: HeadSurface, capture: Capture,
                cut: Cut | None = None) -> tuple[VoxelField, Closed | None]:
    """Close a field's surface where an arc of photos does not show it.

    Parameters
    ----------
    field
        Of a head, without a texture.
    surface
        What it started from.
    capture
        The photos, with mattes.
    cut
        What lies below is none of the head.

    Returns
    -------
    field, closed
        The same field and None where nothing was seen well enough.
    """
    chart, voxel = surface.chart, float(field.spacing.mean())
    distance, colors = read_surface(field, chart, cut)
    photos = Photos(field, capture)
    finite = np.isfinite(distance)
    known = finite & (surface.facing > SQUARE)
    known &= np.abs(distance - surface.distance) < APART / chart.scale
    known[known] = photos.seen(chart.points(distance)[known], chart.rays[known]) >= photos.enough
    known &= coherent(chart, np.where(known, distance, np.nan))
    known = large_pieces(known, np.ones(known.shape), LEAST * known.size)
    if not known.any():
        return field, None
    known = ~large_pieces(~known, np.ones(known.shape), LEAST * known.size)
    # At the outlines photos look along the surface: each locates it badly, all together well.
    rim = ~known & finite & (np.abs(np.where(finite, distance, 0) - surface.distance)
                             < APART / chart.scale)
    rim[rim] = photos.seen(chart.points(distance)[rim]) > 0
    ratio = np.asarray(np.log(np.where((known | rim) & finite, distance, surface.distance)
                              / surface.distance), np.float64)
    whole = surface.distance * np.exp(fitted_plate(
        ratio, np.where(known, 10.0, np.where(rim, RIM, 0.0)), 0.5, 0.01, 1e-4))
    gap = ~known
    area = whole ** 2 * np.cos(chart.elevation)[:, None]
    whole = behind_what_is_seen(chart, whole, gap, photos, nearly=False)
    normal = normals_of(chart, smoothed(whole, np.ones_like(known), 1.0))
    cosine = np.maximum((normal * chart.rays).sum(axis=-1), 0.3)
    # Behind the ears that an arc shows lies what lies above them: hair.
    upwards = np.interp(chart.axis[:, 1], (NAPE - 0.05, NAPE + 0.05), (0.03, 1.0))
    well = shown_well(chart, chart.points(np.where(finite, distance, whole)), known & finite,
                      photos)
    hair, own = hair_cells(chart, whole, colors, well)
    paint = continued_colors(colors, own, upwards, hair)
    shell = Shell(chart, whole, cosine, np.clip(paint, 0, 1),
                  ndimage.binary_dilation(gap, np.ones((3, 3))), voxel, guessed=True)
    closed, count = with_shell(field, shell, photos, cut)
    return closed, Closed(float((area * gap).sum() / area.sum()), count)
