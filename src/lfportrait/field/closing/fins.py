"""Thin sheets that stand out of a mouth, and of a whole head.

A camera that passes a face at one height looks along whatever lies level: a sheet of lip that
reaches towards the cameras looks as the lips do, from all of them. From aside it is a beak. So what
is thin from below to above and stands out of the mouth and the chin goes (`without_fins`); photos
have their word on the lips after that. Elsewhere only what is grown on to the surface goes, and on
a narrow arc alone (`without_beaks`): locks and the rims of spectacles are as thin.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float64
from ..geometry.chart import (
    at_places,
    coherent,
    continued,
    nearest_cells,
    normals_of,
    read_surface,
    smoothed,
)
from ..geometry.head_surface import HeadSurface
from ..grid import VoxelField
from ..trimming import OPAQUE

NOSE, CHIN, CORNERS, MOUTH = 33, 8, [48, 54], slice(48, 68)  # Landmarks.
WIDE, DEEP = 0.7, 0.7
"""The part that is looked at reaches so far aside, over the mouth's width, and so far behind the
lips, over the way from nose to chin."""
THIN = 0.09
"""What is lower than this, over the way from nose to chin, is a sheet: lips are thicker."""
AROUND = (0.25, 0.15)
"""Height and width, over that way, of the surroundings that say where lips and chin lie."""
OUT, ROOT = 1.5, 1.0
"""Voxels in front of them from which on a sheet goes, and with it what is next to it."""
_PLACES = 40  # Places of a mouth along its width and its height.
EMPTY = -1.0  # Optical depth of a voxel that is emptied.


def without_fins(field: VoxelField, landmarks: NDArray[np.floating]) -> VoxelField:
    """A field without thin sheets that stand out of its mouth and chin.

    Parameters
    ----------
    field : Of a head in the portrait frame, without a texture.
    landmarks : [68, 3], iBUG order, of its face.

    Returns
    -------
    field : The same lattice points; those of the sheets are empty.
    """
    ends = landmarks[[NOSE, CHIN, *CORNERS]]
    if not np.isfinite(ends).all():
        return field
    mouth = np.nanmean(landmarks[MOUTH], axis=0)
    tall = float(ends[0, 1] - ends[1, 1])
    aside = WIDE * float(np.linalg.norm(ends[3] - ends[2]))
    low = np.array([mouth[0] - aside, ends[1, 1], mouth[2] - DEEP * tall])
    high = np.array([mouth[0] + aside, ends[0, 1], np.inf])
    shape = field.links.shape[::-1]
    first, last = (np.rint(np.clip((end - field.bounds[0]) / field.spacing - 0.5, 0, shape)
                           ).astype(int) for end in (low, high))
    if (last - first < 3).any():
        return field
    unit = tall / field.spacing
    lowest = round(THIN * float(unit[1]))
    if lowest < 2:  # on so coarse a lattice lips would be sheets
        return field
    # What goes on above or below is as thick as it is there.
    above, below = first[1] - max(first[1] - lowest, 0), min(last[1] + lowest, shape[1]) - last[1]
    links = field.links[first[2]:last[2], first[1] - above:last[1] + below, first[0]:last[0]]
    solid = np.append(field.density > OPAQUE, False)[links]
    thick = ndimage.binary_opening(solid, np.ones((1, lowest, 1)))
    inner = np.s_[:, above:links.shape[1] - below]
    rows = links[inner][_fins(solid[inner], thick[inner], unit)]
    rows = rows[rows >= 0]
    if not len(rows):
        return field
    density = field.density.copy()
    density[rows] = np.minimum(density[rows], np.float32(EMPTY / field.spacing.mean()))
    return replace(field, density=density)


SQUARELY = 0.3
"""Cosine from which on photos see a surface well enough that what stands out of it is known."""
LEVEL = 3  # Rows of a chart (10 mm): what is lower than that is a sheet.
HIGH = 0.0125
"""Portrait units (2.6 mm), a voxel at least, before the surface without sheets from which on they
go."""
_AROUND = 5  # Cells, at a side, that are known about a sheet.
_EVEN = 1.0  # Sigma, in cells, over which that surface is evened.
_BETWEEN = (0.4, 0.6, 0.8)
"""Parts of the way from a sheet to the surface at which a gap is looked for."""
APART = 0.08
"""What was trained further than this from the surface it started from, portrait units, is another
thing."""


def without_beaks(field: VoxelField, surface: HeadSurface,
                  ) -> tuple[VoxelField, Float64, Float64]:
    """A field of a narrow arc without sheets that stand out of its surface like beaks.

    Brows, lids and lips are lines that lie level, as the arc does. What hangs before the face
    without touching it, as the rims of spectacles, stays.

    Parameters
    ----------
    field : Without a texture.
    surface : What it started from.

    Returns
    -------
    field, places, normals : The same lattice points, those of the sheets empty; and where the
        surface lies bare now, [N, 3], with its outward normals [N, 3].
    """
    chart, voxel = surface.chart, float(field.spacing.mean())
    distance, _ = read_surface(field, chart, None)
    known = np.isfinite(distance)
    known[known] = np.abs(distance - surface.distance)[known] < APART / chart.scale
    known &= coherent(chart, np.where(known, distance, np.nan))
    if not known.any():
        return field, np.zeros((0, 3)), np.zeros((0, 3))
    every = np.ones(known.shape, bool)
    log = continued(np.where(known, np.log(np.where(known, distance, 1.0)), 0.0)[..., None],
                    known)[..., 0]
    even = smoothed(np.exp(ndimage.grey_opening(log, (LEVEL, 1))), every, _EVEN)
    normals = normals_of(chart, even)
    cosine = np.maximum((normals * chart.rays).sum(axis=-1), SQUARELY)
    # A sheet is a jump, which hangs together with nothing: what is around it is known.
    asked = ndimage.binary_closing(known, np.ones((_AROUND, _AROUND)))
    asked = ndimage.binary_erosion(asked, np.ones((3, 3))) & (surface.facing > SQUARELY)
    points = field.lattice_points()
    places, away = chart.places(points)
    out = (away - at_places(even, places)) * at_places(cosine, places)
    gone = np.flatnonzero(nearest_cells(asked, places) & (out > max(HIGH / chart.scale, voxel)))
    gone = gone[~_apart(field, points[gone], chart.points(even), places[:, gone])]
    solid = field.density[gone] > OPAQUE
    density = field.density.copy()
    density[gone] = np.minimum(density[gone], np.float32(EMPTY / voxel))
    bare: Bool = np.zeros(distance.shape, bool)
    row, column = np.rint(places[:, gone[solid]]).astype(np.int64)
    bare[np.clip(row, 0, len(bare) - 1), column % len(chart.angle)] = True
    bare = ndimage.binary_dilation(bare, np.ones((3, 3)))
    return replace(field, density=density), chart.points(even)[bare], normals[bare]


def _apart(field: VoxelField, points: Float64, surface: Float64, places: Float64) -> Bool:
    """Which points [N, 3] are part of what hangs before a surface [V, U, 3], or next to it, [N].

    ``places`` [2, N] are the points' on the surface. A piece hangs if there is a gap between the
    surface and most of its points.
    """
    below = np.stack([at_places(surface[..., k], places) for k in range(3)], axis=-1)
    dense = np.append(field.density > OPAQUE, False)

    def solid(at: Float64) -> tuple[Bool, Any]:
        cells = np.floor((at - field.bounds[0]) / field.spacing).astype(np.int64)
        inside = ((cells >= 0) & (cells < field.links.shape[::-1])).all(axis=1)
        z, y, x = np.where(inside[:, None], cells, 0)[:, ::-1].T
        return inside & dense[field.links[z, y, x]], (z, y, x)

    matter, cells = solid(points)
    gap = np.zeros(len(points), bool)
    for share in _BETWEEN:
        gap |= ~solid(points + share * (below - points))[0]
    grid = np.zeros(field.links.shape, bool)
    grid[tuple(part[matter] for part in cells)] = True
    pieces, count = ndimage.label(grid, np.ones((3, 3, 3)))
    own = pieces[cells]
    total = np.bincount(own[matter], minlength=count + 1)
    hangs = np.bincount(own[matter], gap[matter], minlength=count + 1) > 0.5 * total
    hangs[0] = False
    return np.asarray(ndimage.binary_dilation(hangs[pieces], np.ones((3, 3, 3)))[cells])


def mouth_of(landmarks: NDArray[np.floating]) -> Float64:
    """Places [N, 3] all over the mouth, of which sheets may have gone; none without landmarks."""
    lips = np.asarray(landmarks, np.float64)[MOUTH]
    lips = lips[np.isfinite(lips).all(axis=1)]
    if not len(lips):
        return lips
    low, high = lips.min(axis=0), lips.max(axis=0)
    across, up = np.meshgrid(np.linspace(low[0], high[0], _PLACES),
                             np.linspace(low[1], high[1], _PLACES))
    depth = np.full(across.size, lips[:, 2].mean())
    return np.stack([across.ravel(), up.ravel(), depth], axis=1)


def _fins(solid: Bool, thick: Bool, unit: NDArray[np.floating]) -> Bool:
    """Which points are to be emptied, bool [z, y, x]; ``unit`` [3] in points (x, y, z)."""
    depth = len(solid)
    # Where nothing is thick nothing stands out.
    front = np.where(thick.any(axis=0), depth - 1 - np.argmax(thick[::-1], axis=0), depth)
    around = [max(3, round(part * size)) for part, size in zip(AROUND, unit[1::-1])]
    front = ndimage.median_filter(front, around, mode="nearest")
    before = np.arange(depth)[:, None, None] - front
    fins = solid & ~thick & (before > OUT)
    return np.asarray(ndimage.binary_dilation(fins, np.ones((3, 3, 3))) & (before > ROOT))
