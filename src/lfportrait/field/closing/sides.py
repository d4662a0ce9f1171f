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

from ...capture import Capture, portrait_frame_from_landmarks
from ..geometry.chart import Chart, coherent, normals_of, read_surface
from ..geometry.head_surface import HeadSurface
from ..geometry.plate import fitted_plate, large_pieces, smoothed
from ..grid import VoxelField
from ..trimming import Cut
from .back import Closed, shades
from .ears import Ears, ears_of
from .fitted_head import FitHead, FittedHead, head_distance
from .photos import Photos, behind_what_is_seen
from .shell import Shell, with_shell

__all__ = ["close_sides"]

Float64 = NDArray[np.float64]

SQUARE = 0.05
"""Cosine between normal and way to the cameras from which on photos see a surface well."""
NAPE = -0.35
"""Height at which hair usually ends behind, portrait units."""
WELL = 0.35
"""Cosine from which on they are believed wholly."""
YIELDS = 0.7
"""Confidence up to which what was trained yields to the new surface."""
LITTLE = 0.3
"""Confidence from which on a head is fitted to a surface."""
SURE = 10.0
"""Weight of a surface that photos see well."""
RIM = 0.3
"""Weight of a surface that photos look along, over one that they see well."""
APART = 0.08
"""A trained surface further than this from the one it started from is another thing."""
_HAIRLINE = np.array([
    # height, degrees from the front
    (NAPE - 0.01, 181.0), (NAPE, 125.0), (-0.15, 108.0), (-0.02, 105.0), (0.05, 85.0), (0.20, 60.0),
    (0.36, 0.0), (0.37, -1.0)])
"""Where hair begins on most heads: before the crown, above and behind the ears, at the nape."""
LEAST = 0.003
"""Share of the chart that a piece has at least, seen or not."""


def close_sides(field: VoxelField, surface: HeadSurface, capture: Capture,
                cut: Cut | None = None, fit_head: FitHead | None = None,
                ) -> tuple[VoxelField, Closed | None]:
    """Close a field's surface where an arc of photos does not show it.

    Parameters
    ----------
    field
        Of a head, without a texture.
    surface
        What it started from.
    capture
        The photos, with mattes and landmarks.
    cut
        What lies below is none of the head.
    fit_head
        Fits a head to what the photos show, which the sides follow; None: they follow ``surface``.

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
    head = None if fit_head is None else _fitted(fit_head, surface, capture,
                                                 np.where(known, distance, np.nan))
    known = ~large_pieces(~known, np.ones(known.shape), LEAST * known.size)
    base, ears = surface.distance, None
    if head is not None:
        base = head_distance(head, chart, surface.distance)
        ears = ears_of(head, chart, photos, capture)
    # At the outlines photos look along the surface: each locates it badly, all together well.
    rim = ~known & finite & (np.abs(np.where(finite, distance, 0) - surface.distance)
                             < APART / chart.scale)
    rim[rim] = photos.seen(chart.points(distance)[rim]) > 0
    trust = np.where(known, SURE, np.where(rim, RIM, 0.0))
    if head is not None:
        trust = np.where(known, np.maximum(SURE * _confidence(surface.facing) ** 2, RIM), trust)
        known &= _confidence(surface.facing) > YIELDS
    if ears is not None:
        beside = _ear_cells(chart, ears)
        trust[beside] = 0.0
        known &= ~beside
    ratio = np.asarray(np.log(np.where((trust > 0) & finite, distance, base) / base), np.float64)
    whole = base * np.exp(fitted_plate(ratio, np.where(finite, trust, np.minimum(trust, 0.0)) if head is not None else trust, 0.5, 0.01, 1e-4 if head is None else 2e-5))
    gap = ~known
    area = whole ** 2 * np.cos(chart.elevation)[:, None]
    whole = behind_what_is_seen(chart, whole, gap, photos, nearly=False)
    normal = normals_of(chart, smoothed(whole, np.ones_like(known), 1.0))
    cosine = np.maximum((normal * chart.rays).sum(axis=-1), 0.3)
    # Behind the ears that an arc shows lies what lies above them: hair.
    upwards = np.interp(chart.axis[:, 1], (NAPE - 0.05, NAPE + 0.05), (0.03, 1.0))
    paint = shades(chart, chart.points(np.where(finite, distance, whole)), colors,
                   known & finite, photos, upwards, _hair(chart, whole))
    shell = Shell(chart, whole, cosine, np.clip(paint, 0, 1),
                  ndimage.binary_dilation(gap, np.ones((3, 3))), voxel, guessed=True, ears=ears)
    closed, count = with_shell(field, shell, photos, cut)
    return closed, Closed(float((area * gap).sum() / area.sum()), count)


def _confidence(facing: Float64) -> Float64:
    """How far photos that look at a surface at cosines [V, U] tell where it lies, 0 to 1."""
    return np.asarray(np.clip((facing - SQUARE) / (WELL - SQUARE), 0, 1), np.float64)


def _fitted(fit_head: FitHead, surface: HeadSurface, capture: Capture, distance: Float64,
            ) -> FittedHead | None:
    """A head fitted to landmarks and to distances [V, U]; they are NaN where nothing is known."""
    chart = surface.chart
    frame = portrait_frame_from_landmarks(np.asarray(capture.landmarks, np.float64),
                                          capture.cameras)
    landmarks = np.asarray(capture.landmarks, np.float64) @ frame[:3, :3].T + frame[:3, 3]
    trust = np.where(np.isfinite(distance), _confidence(surface.facing), 0.0)
    used = trust > LITTLE
    even = np.where(used, smoothed(np.where(used, distance, 0.0), used, 1.0), surface.distance)
    normals = normals_of(chart, even)[used]
    points = chart.points(np.where(used, distance, 1.0))[used]
    if chart.frame is not None:
        points = points @ chart.frame[:3, :3].T + chart.frame[:3, 3]
        normals = normals @ chart.frame[:3, :3].T / chart.scale
    return fit_head(landmarks, points, normals, trust[used])


def _ear_cells(chart: Chart, ears: Ears) -> NDArray[np.bool_]:
    """Cells of a chart whose rays meet ears, and those next to them, [V, U]."""
    found = np.zeros((len(chart.axis), len(chart.angle)), bool)
    row, column = np.rint(chart.places(ears.points[ears.own])[0]).astype(np.int64)
    inside = (row >= 0) & (row < len(found))
    found[row[inside], column[inside] % found.shape[1]] = True
    return np.asarray(ndimage.binary_dilation(np.pad(found, ((0, 0), (2, 2)), mode="wrap"),
                                              np.ones((3, 3)))[:, 2:-2])


def _hair(chart: Chart, distance: Float64) -> NDArray[np.bool_]:
    """Where most heads have hair, bool [V, U]: one color goes on over a bald head, too."""
    up = np.sin(chart.elevation)[:, None] * distance * chart.scale
    begins = np.interp(chart.axis[:, 1][:, None] + up, *_HAIRLINE.T)
    return np.asarray(np.degrees(np.abs(chart.angle)) > begins)
