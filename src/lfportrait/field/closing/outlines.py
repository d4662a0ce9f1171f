"""A closed surface fills the outlines that photos show of it.

Where photos only look along a surface, a head or a bust is put in the place of what was trained
there. It may lie within the outlines: then pixels in which mattes show the person would see the
wall, and what is trained after that sticks rags and haze to the edge. So the surface is raised
where it lacks such matter. Along each ray that misses it, it is raised where it comes nearest: that
is the least that fills the ray, and hardly any other photo sees past it (`behind_what_is_seen`).
Each photo gives a curve of such places, of which a few must lie near each other; a plate that bends
little goes on between them. So a wisp of hair or a notch in a matte raises little.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ...arrays import Bool, Float64
from ...simd.threads import side_by_side
from ..geometry.chart import Chart, at_places, fitted_plate, nearest_cells, normals_of, smoothed
from .photos import Photos, behind_what_is_seen

ROUNDS = 2  # Times that a surface is raised: a raised part lies nearest to other rays.
NEAR, FAR = 0.5, 16.0
"""Voxels from a surface from which on, and up to which, a ray that misses it raises it."""
FIRM, LOOSE = 1.0, 1e-2
"""Weight of what rays ask for, and the pull back to the surface elsewhere: in some three cells it
is reached."""
STAYS = 10.0  # Weight of what stays where it is.
_REACH, _STEP, _FINE = 60.0, 3.0, 0.75
"""Voxels along a ray, from what it was trained to meet, in which it is looked for where it comes
nearest; steps; and finer steps about the best of these."""


def filling_outlines(chart: Chart, distance: Float64, gap: Bool, photos: Photos) -> Float64:
    """Distances [V, U] so long in a gap that the surface fills the photos' outlines.

    Parameters
    ----------
    chart, distance : The closed surface, [V, U], world units.
    gap : bool [V, U], where it may be raised.
    photos : What the photos, which have mattes, see of what was trained.
    """
    out = distance
    for _ in range(ROUNDS):
        missing = lacking(chart, out, gap, photos)
        asked = missing > 0
        if not asked.any():
            break
        # What is raised is known to within a cell: neighbours are raised alike.
        weights = np.where(asked, FIRM, np.where(gap, 0.0, STAYS))
        plate = fitted_plate(missing, weights, 0.5, 0.01, LOOSE)
        higher = out + np.where(gap, np.maximum(plate, 0.0), 0.0)
        raised = behind_what_is_seen(chart, higher, higher > out, photos, nearly=False)
        out = np.maximum(out, raised)
    return out


def lacking(chart: Chart, distance: Float64, gap: Bool, photos: Photos) -> Float64:
    """How much longer distances [V, U] must be for photos' outlines to be filled, [V, U].

    The parameters are those of `filling_outlines`; world units, 0 where nothing is lacking.
    """
    every = np.ones(gap.shape, bool)
    normals = normals_of(chart, smoothed(distance, every, 1.0))
    cosine = np.maximum((normals * chart.rays).sum(axis=-1), 0.3)
    voxel = photos.voxel

    def depth(points: Float64) -> tuple[Float64, Float64]:
        """Depths of points [N, 3] within the surface, in voxels, and their places [2, N]."""
        places, away = chart.places(points)
        return ((at_places(distance, places) - away) * at_places(cosine, places) / voxel, places)

    def inside(places: Float64) -> Bool:
        """Which places [2, N] lie between the chart's rows, [N]."""
        return np.asarray((places[0] >= 0) & (places[0] <= len(distance) - 1))

    def missed(view: int) -> tuple[Float64, Float64]:
        """Where rays of a view that miss the surface come nearest: places [2, N], and how near."""
        points, rays = photos.person(view)
        found, places = depth(points)
        # A body goes on below the chart.
        chosen = (found < 0) & nearest_cells(gap, places) & inside(places)
        points, rays, places, best = points[chosen], rays[chosen], places[:, chosen], found[chosen]
        at = np.zeros(len(points))
        for reach, step in ((_REACH, _STEP), (_STEP - _FINE, _FINE)):
            middle = at.copy()
            for along in np.arange(-reach, reach + 0.5 * step, step):
                now = middle + along
                deep, there = depth(points + (now * voxel)[:, None] * rays)
                better = (deep > best) & inside(there)
                at[better], best[better] = now[better], deep[better]
                places[:, better] = there[:, better]
        lacks = (best < -NEAR) & (best > -FAR)
        return places[:, lacks], best[lacks]

    asks = []
    for places, best in side_by_side(missed, range(len(photos.cameras))):
        row, column = np.rint(places).astype(np.int64)
        more = np.zeros(gap.shape)
        np.maximum.at(more, (row, column % gap.shape[1]),
                      -best * voxel / at_places(cosine, places))
        asks.append(more)
    asked = gap & (np.max(asks, axis=0) > 0)
    # Photos' curves run between each other's cells.
    wide = [ndimage.maximum_filter(more, 3, mode=("nearest", "wrap")) for more in asks]
    # Mattes of a few photos may be wrong. Beside the gap nothing is new: what was trained there
    # fills the ray.
    several = np.sort(wide, axis=0)[-min(photos.enough + 1, len(wide))]
    return np.where(asked, several, 0.0)
