"""Colors where photos of a narrow arc only look along a surface.

There a pixel covers many lattice points one behind the other, and what they share of its color is
arbitrary: nobody who looks from where the photos were taken sees it, but from aside a jaw is
stippled and a temple streaked. So the surface is read once more when its last training is done.
Its colors lose their specks in a median, which keeps the edge of a jaw, and its chroma is smoothed
wider than its lightness, to which eyes are sharper. The less squarely photos look, the more of it
counts. Hair has the colors of before that training where photos do not face it, as at an outline
the photos' ground gets into them; and the less they do, the more it has those that photos show
along it, or else those that it was closed in (`Grazed.paint`). What was trained of the last locks
that photos see is a ragged edge from aside, dark or bright, beside smooth closed hair.

Ears have no place in a chart: neither the fitted ones nor what stands out beside them, where true
ears are not as the fitted. What hardly any photo faces there takes the colors of what is faced
around it, and so does what has another tint than the ear: a strip of the wall in some mattes.

Photos themselves have no such noise: where enough of them look at the skin's surface, they are
looked up there (`Photos.colors`), and only what they do not show is left to the median.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from ...arrays import Bool, Float32, Float64, Int64
from ...capture import Camera
from ...measure import usable_cores
from ..geometry.chart import (
    Chart,
    at_places,
    continued,
    nearest_cells,
    normals_of,
    read_surface,
    smoothed,
    widened,
)
from ..geometry.head_surface import cosines_of
from ..grid import Cut, VoxelField
from ..kernels.march import C0
from ..trimming import OPAQUE
from .colors import of_another_tint
from .fitted_head import Ears
from .photos import Photos

SQUARELY = 0.5
"""Cosine to the photos that see a place best from which on their colors stay as they are."""
HAIR_SQUARELY = 0.8  # The same for hair, whose locks hide each other.
LITTLE = 0.5  # Share of the photos' colors below which those of the ground are looked for.
BARELY = 0.1, 0.2  # Cosines over which the photos themselves say what colors are.
BEST = 0.8  # Quantile of the cosines to the photos that counts.
MEDIAN = (5, 7)
"""Rows and columns of the median. Photos are taken side by side: more columns than rows are
foreshortened."""
CHROMA, GRAIN = 3.0, 0.8  # Sigma, in cells, of chroma, and of all that the median leaves.
SHOULDERS = (-0.95, -0.75)
"""Heights, portrait units, over which a body's colors begin to stay: clothes have patterns."""
OUTER, INNER = 8.0, 9.0
"""Voxels outside and inside of the surface up to which lattice points belong to it."""
ON = 4.0  # Voxels beside the surface up to which what a ray meets shows its color.
BESIDE = 3.0
"""Voxels around ears that belong to them: depth maps, not the chart, know where they face."""
STANDS_OUT = 2.0, 20.0
"""Voxels by which what stands out of the surface, where rays may meet ears, is an ear's, too."""
NEXT = 3
"""Cells around those of ears in which hair keeps its colors: true ears are not as fitted ones."""
FACED, SURELY = 0.2, 4
"""An ear's colors stay where so many photos see a surface that faces them at such a cosine."""
ALIKE = 24  # Places of an ear around one whose median tells its color.
WIDELY, TINT = 400, 0.045
"""Those whose median tells its tint (sRGB in [0, 1] without lightness), and how much of another
tint it has if it is the wall's."""
_EVEN = 1.5
"""Sigma, in cells, over which a surface is evened before its cosines are taken, and these."""


@dataclass(frozen=True)
class Grazed:
    """The surface of a closed head, and how squarely photos look at it."""

    # chart, distance: The surface, float64 [V, U], world units.
    chart: Chart
    distance: Float64
    # float64 [V, U], 0 where photos see nothing or look along it, 1 where they see it well.
    faced: Float64
    ears: Ears | None  # Solids beside it, or None.
    beside: Bool  # bool [V, U], cells whose rays may meet ears.
    # bool [V, U], cells that keep apart from the others, and their colors; None: one color.
    hair: Bool | None
    cut: Cut | None  # What lies below is none of the head.
    photos: Photos | None = None  # What they show; None: only the field tells colors.
    gap: Bool | None = None  # bool [V, U], where the surface is new; None: everywhere.
    # float64 [V, U, 3], the colors it was closed in: hair has them where photos show nothing, and
    # skin of another tint is none. None: hair keeps its own.
    paint: Float64 | None = None

    def new(self) -> tuple[Float64, Float64]:
        """Places where the surface or an ear is new, and outward normals there, [N, 3] each."""
        every = np.ones(self.faced.shape, bool)
        normals = normals_of(self.chart, smoothed(self.distance, every, 1.0))
        gap = every if self.gap is None else self.gap
        places, normals = self.chart.points(self.distance)[gap], normals[gap]
        if self.ears is not None:
            places = np.concatenate([places, self.ears.points[self.ears.own]])
            normals = np.concatenate([normals, self.ears.normals[self.ears.own]])
        return places, normals


def photo_colors(photos: Photos, chart: Chart, distance: Float64, colors: Float64,
                 covered: Bool) -> tuple[Float64, Float64]:
    """A surface's colors as photos show them, where they do, and how far these count.

    Parameters
    ----------
    photos : The photos.
    chart, distance : The surface, float64 [V, U], world units.
    colors : Those of the field, float64 [V, U, 3].
    covered : bool [V, U], cells where the field has that surface.

    Returns
    -------
    colors, share : float64 [V, U, 3]; and [V, U], 0 where the field's colors stay, to 1.
    """
    normals = normals_of(chart, smoothed(distance, np.ones(covered.shape, bool), _EVEN))
    shown, facing = photos.colors(chart.points(distance), normals,
                                  np.where(covered[..., None], colors, np.nan))
    share = np.where(covered, np.clip((facing - BARELY[0]) / (BARELY[1] - BARELY[0]), 0, 1), 0.0)
    return colors + share[..., None] * (shown - colors), np.asarray(share, np.float64)


def faced_by(chart: Chart, distance: Float64, cameras: Camera, hair: Bool | None = None,
             ) -> Float64:
    """How far colors of a surface's cells are the photos', float64 [V, U] (`Grazed.faced`).

    Parameters
    ----------
    chart, distance : The surface, float64 [V, U], world units.
    cameras : Of the photos.
    hair : bool [V, U], cells of hair; None: none.
    """
    even = smoothed(distance, np.ones(distance.shape, bool), _EVEN)
    cosine = np.quantile(cosines_of(chart, even, cameras), BEST, axis=0)
    cosine = ndimage.gaussian_filter(np.clip(cosine, -0.2, 1.0), _EVEN, mode=("nearest", "wrap"))
    square = SQUARELY if hair is None else np.where(hair, HAIR_SQUARELY, SQUARELY)
    share = np.clip(cosine / square, 0, 1)
    body = np.interp(chart.axis[:, 1], SHOULDERS, (1.0, 0.0))[:, None]
    return np.asarray(np.maximum(share * share * (3 - 2 * share), body), np.float64)


def without_specks(colors: Float64, covered: Bool, hair: Bool | None) -> Float64:
    """Colors [V, U, 3] of a chart without what differs from cell to cell.

    Parameters
    ----------
    colors, covered : float64 [V, U, 3] and bool [V, U]: colors, and where there are any.
    hair : bool [V, U]: across the border of these cells nothing goes on; None: there is none.
    """
    whole = continued(colors, covered, apart=hair)
    whole = np.stack([ndimage.median_filter(whole[..., k], MEDIAN, mode="wrap")
                      for k in range(3)], axis=-1)
    light = whole.mean(axis=-1, keepdims=True)
    every = np.ones(covered.shape, bool)
    out = np.empty_like(whole)
    for part in (every,) if hair is None else (hair, ~hair):
        even = smoothed(light, part, GRAIN) + smoothed(whole - light, part, CHROMA)
        out[part] = even[part]
    return out


def with_even_colors(field: VoxelField, grazed: Grazed, closed: VoxelField | None = None,
                     ) -> VoxelField:
    """A trained field whose colors are even where photos only look along its surface.

    Parameters
    ----------
    field : Without a texture.
    grazed : Its surface.
    closed : The same lattice points before the last training, whose colors hair has where photos
        do not face it, under `Grazed.paint`; None: those of ``field``.

    Returns
    -------
    field : The same lattice points and densities.
    """
    chart, voxel = grazed.chart, float(field.spacing.mean())
    normal = normals_of(chart, smoothed(grazed.distance, np.ones(grazed.faced.shape, bool), 1.0))
    cosine = np.maximum((normal * chart.rays).sum(axis=-1), 0.3)
    distance, colors = read_surface(field, chart, grazed.cut)
    covered = np.isfinite(distance) & ~grazed.beside
    covered[covered] = (np.abs(distance - grazed.distance) * cosine)[covered] < ON * voxel
    if not covered.any():
        return field
    own = covered & ~_of_the_ground(grazed, colors)
    even, twice = without_specks(colors, own if own.any() else covered, grazed.hair), 1
    stays = grazed.faced
    if grazed.hair is not None and grazed.paint is not None:
        even[grazed.hair] = grazed.paint[grazed.hair]
    elif grazed.hair is not None:
        stays = np.maximum(stays, grazed.hair)
    if grazed.photos is not None:
        even, twice = _shown_finely(grazed, distance, np.nan_to_num(colors), covered, even), 2
    points = field.lattice_points()
    places, away = chart.places(points)
    deep = (at_places(grazed.distance, places) - away) * at_places(cosine, places) / voxel
    share = 1.0 - at_places(stays, places)
    share[(deep < -OUTER) | (deep > INNER)] = 0.0
    sh = field.sh
    if grazed.hair is not None and closed is not None:
        near = nearest_cells(grazed.hair, places) & (deep > -OUTER) & (deep < INNER)
        sh = _with_hair_as_closed(sh, closed.sh, np.flatnonzero(near),
                                  1.0 - at_places(grazed.faced, places[:, near]))
    if grazed.ears is not None:
        low, high = STANDS_OUT
        near = nearest_cells(grazed.beside, places) & (-high < deep) & (deep < -low)
        near |= grazed.ears.distance(points)[0] < BESIDE * voxel
        if grazed.hair is not None:
            around = widened(grazed.beside, NEXT) & grazed.hair
            share[nearest_cells(around, places)] = 0.0
        share[near] = 0.0
        if grazed.photos is not None:
            sh = _with_even_ears(sh, np.flatnonzero(near), points, field.density, grazed.photos)
    chosen = np.flatnonzero(share > 0)
    places = twice * places[:, chosen] + [[0.0], [0.5 * (twice - 1)]]
    colors = np.stack([at_places(even[..., k], places) for k in range(3)], axis=-1)
    return replace(field, sh=_blended(sh, chosen, share[chosen], colors))


def _of_the_ground(grazed: Grazed, colors: Float64) -> Bool:
    """Cells [V, U] of skin that photos only look along, in a color that is not the skin's.

    Where a closed surface stands out of the true outline it takes the color of what is behind.
    """
    if grazed.paint is None:
        return np.zeros(grazed.faced.shape, bool)
    found = (grazed.faced < LITTLE) & of_another_tint(np.nan_to_num(colors), grazed.paint)
    return found if grazed.hair is None else found & ~grazed.hair


def _with_hair_as_closed(sh: Float32, closed: Float32, rows: Int64, share: Float64) -> Float32:
    """Coefficients, of which those of hair's rows go over by a share [N] into ``closed``.

    Closed hair that stands out of the true outline is made clear by the photos' ground, but takes
    the ground's color as well: light specks in the hair beside an ear.
    """
    out = sh.copy()
    out[rows] += share[:, None, None].astype(np.float32) * (closed[rows] - sh[rows])
    return out


def _with_even_ears(sh: Float32, rows: Int64, points: Float64, density: Float32,
                    photos: Photos) -> Float32:
    """Coefficients, those of ears' rows in the colors around where hardly any photo faces them.

    So are those of a strip of the wall beside an ear, which some mattes have: its tint is not that
    of the ear.
    """
    at, colors = points[rows], 0.5 + C0 * sh[rows, :, 0]
    votes = photos.faced(at, FACED)
    faced = (votes >= SURELY) & (density[rows] > OPAQUE)
    if faced.sum() < ALIKE:
        return sh
    # Shade, hair and gray things have less of the same tint.
    tint = colors - colors.mean(axis=1, keepdims=True)
    many = min(WIDELY, int(faced.sum()))
    # Every eighth will do.
    around = cKDTree(at[faced]).query(at, np.arange(1, many + 1, 8), workers=usable_cores())[1]
    usual = np.median(tint[faced][around], axis=1)
    usual /= np.maximum(np.linalg.norm(usual, axis=1, keepdims=True), 1e-9)
    tint -= np.maximum((tint * usual).sum(axis=1, keepdims=True), 0.0) * usual
    strange = np.linalg.norm(tint, axis=1) > TINT
    faced &= ~strange
    if faced.sum() < ALIKE:
        return sh
    share = np.where(strange, 1.0, 1.0 - np.clip(votes / SURELY, 0, 1))
    chosen = np.flatnonzero(share > 0)
    around = cKDTree(at[faced]).query(at[chosen], ALIKE, workers=usable_cores())[1]
    return _blended(sh, rows[chosen], share[chosen], np.median(colors[faced][around], axis=1))


def _shown_finely(grazed: Grazed, distance: Float64, colors: Float64, covered: Bool,
                  even: Float64) -> Float64:
    """Even colors [V, U, 3], replaced by the photos' where these show any, in `Chart.finer`."""
    chart, halves = grazed.chart, grazed.chart.halves
    assert grazed.photos is not None

    def between(values: Float64) -> Float64:
        return at_places(values, halves.reshape(2, -1)).reshape(halves.shape[1:])

    colors, even = (np.stack([between(part[..., k]) for k in range(3)], axis=-1)
                    for part in (colors, even))
    shown, share = photo_colors(grazed.photos, chart.finer(),
                                between(np.where(covered, distance, grazed.distance)), colors,
                                between(covered.astype(np.float64)) > 0.99)
    return np.asarray(even + share[..., None] * (shown - even), np.float64)


def _blended(sh: Float32, rows: Int64, share: Float64, colors: Float64) -> Float32:
    """Coefficients, of which those of some rows go over by a share [N] into colors [N, 3]."""
    out = sh.copy()
    some = sh[rows] * (1.0 - share)[:, None, None].astype(np.float32)
    some[:, :, 0] += share[:, None] * (colors - 0.5) / C0
    out[rows] = some
    return out
