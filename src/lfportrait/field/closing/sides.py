"""Close a head that photos do not show all around: behind, and at its sides.

Where photos look along the surface or do not see it at all, what was trained there is what little
the outlines left over: fringes, haze, holes. Of an arc wide enough to show where the gap behind
begins, the surface is continued over it (`close_back`). Else the surface that the field started
from (`lfportrait.field.geometry.head_surface`) takes its place, bent to the trained one where that
begins, in the colors around it (`close_sides`). Where a statistical head is installed, a head
fitted to the capture takes the place instead, with its ears (`fitted_head`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float64, Int64
from ...capture import Camera, Capture, portrait_frame_from_landmarks
from ..geometry.chart import (
    Chart,
    chart_of,
    coherent,
    continued,
    fitted_plate,
    large_pieces,
    normals_of,
    read_surface,
    smoothed,
    widened,
)
from ..geometry.head_surface import HeadSurface
from ..grid import Cut, VoxelField
from ..trimming import OPAQUE
from .colors import (
    EARS,
    NAPE,
    continued_in_shade,
    hair_cells,
    heights_of,
    skin_by_color,
    usual_hair,
)
from .fitted_head import Ears, FitHead, FittedHead, cells_of, ears_of, head_distance
from .grazed import Grazed, faced_by, photo_colors
from .outlines import filling_outlines
from .photos import Photos, behind_what_is_seen
from .shell import FRINGE, Shell, with_shell

BEHIND = np.radians(75.0)  # Angle from the front from which on gaps are closed.
AROUND = 100.0
"""Photos all around a head are nowhere further apart, in degrees about the vertical axis."""
INSIDE = -0.3
"""Cosine between a chart's ray and the way to a photo below which that sees the other side."""
KNOWN = 0.3  # Share of the chart that must be known for anything to be continued from it.
LEAST_BEHIND = 0.005  # Share of the surface that a gap has at least: an ear's shadow is none.


@dataclass(frozen=True)
class Closed:
    """What `close_back` did."""

    share: float  # Share of the surface that was open.
    points: int  # Lattice points that are new.
    # Where photos of a narrow arc only look along the surface; None: it is closed behind alone.
    grazed: Grazed | None = None


def close_back(field: VoxelField, landmarks: NDArray[np.floating], capture: Capture,
               cut: Cut | None = None) -> tuple[VoxelField, Closed | None]:
    """Close a field's surface where no photo shows it.

    Parameters
    ----------
    field : Of a head, in the portrait frame, without a texture.
    landmarks : [68, 3], iBUG order, of its face.
    capture : The photos that it was reconstructed from, with mattes.
    cut : What lies below is none of the head (`find_cut`).

    Returns
    -------
    field, closed : The same field and None where nothing is open.
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
    known = large_pieces(known, np.ones(known.shape), LEAST_BEHIND * known.size)
    if known.mean() < KNOWN:
        return field, None
    gap = ~known & (np.abs(chart.angle) > BEHIND)
    log = np.log(np.maximum(np.where(known, distance, 1.0), voxel))
    whole = np.exp(continued(log[..., None], known, bending=1.0)[..., 0])
    area = whole ** 2 * np.cos(chart.elevation)[:, None]
    gap = large_pieces(gap, area, LEAST_BEHIND * float(area.sum()))
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


PHOTOS = 24
"""Photos of an arc, at most, that are asked what they see: with 40 a head is 0.1 dB better."""
SQUARE = 0.05
"""Cosine between normal and way to the cameras from which on photos see a surface well."""
WELL = 0.35  # Cosine from which on they are believed wholly.
YIELDS = 0.7  # Confidence up to which what was trained yields to the new surface.
LITTLE = 0.3  # Confidence from which on a head is fitted to a surface.
SURE = 10.0  # Weight of a surface that photos see well.
RIM = 0.3  # Weight of a surface that photos look along, over one that they see well.
APART = 0.08  # A trained surface further than this from the one it started from is another thing.
LOOSE, LAX, FOLLOWS = 1e-4, 2e-5, 3e-3
"""Pull towards a bust, a fitted head under hair, and its skin."""
NECK = -0.75
"""Height above which a fitted head is followed, portrait units: below, shoulders begin."""
SIDES = np.radians(100.0)  # Angle from the front up to which it is, where it has no hair.
UNLIKELY = 0.05  # What slanting rays saw so far from a fitted head's skin is not believed: 1 cm.
HIDDEN = -0.5  # Cosine below which photos do not see a surface at all.
STANDS_OUT, EAR_STANDS_OUT = -2.0, -4.0
"""Voxels that what was trained may stand out from a fitted head's skin, and from its ears."""
NARROW_FRINGE = -0.75
"""Voxels outside of a surface that follows a fitted head at which its fringe begins."""
ON, SURELY = 3.0, 0.5
"""Voxels beside the closed surface up to which what was trained is that surface, and the share of
the photos' own colors from which on closed colors begin at them."""
_SHORTEST = 0.05  # Of the circles of rows at the crown, over those below.
_EVENLY = 2.0  # Sigma, in cells, over which the thickness of hair is evened.
_THICKENS, _BULKY = ((-0.25, 0.25), (-0.35, 0.05)), (0.1, 0.4)
"""Heights, portrait units, over which hair above a nape becomes thick: flat hair, and hair as bulky
as curls; and thicknesses beside ears (logarithm of the distance over the skull's) of both."""
_BESIDE_FACE = np.radians(60.0)  # Angle from the front from which on hair is beside a face.
_BESIDE_NECKS = (65.0, 78.0, 92.0, 110.0), (0.0, 1.0, 1.0, 0.0)
_BELOW_JAWS = (-0.45, -0.35), (1.0, 0.0)
"""Angles from the front, degrees, and heights, portrait units, over which a neck may be wider than
the fitted head's."""
_EARS_END = 105.0  # Degrees from the front at which most ears end.
ABOUT_EARS = 4  # Cells around a fitted head's ears in which the true ones may lie.
KNOT = 3  # Cells around a knot that are part of it.
CRUMB = 3.0  # Cells that a piece at the outlines has at least.
LEAST = 0.003  # Share of the chart that a piece has at least, seen or not.


def close_sides(field: VoxelField, surface: HeadSurface, capture: Capture, cut: Cut | None = None,
                fit_head: FitHead | None = None) -> tuple[VoxelField, Closed | None]:
    """Close a field's surface where an arc of photos does not show it.

    Parameters
    ----------
    field : Of a head, without a texture.
    surface : What it started from.
    capture : The photos, with mattes and landmarks.
    cut : What lies below is none of the head.
    fit_head : Fits a head to what the photos show, which the sides follow; None: they follow
        ``surface``.

    Returns
    -------
    field, closed : The same field and None where nothing was seen well enough.
    """
    chart, voxel = surface.chart, float(field.spacing.mean())
    distance, colors = read_surface(field, chart, cut)
    photos = Photos(field, capture, PHOTOS)
    finite = np.isfinite(distance)
    known = finite & (surface.facing > SQUARE)
    known &= np.abs(distance - surface.distance) < APART / chart.scale
    known[known] = photos.seen(chart.points(distance)[known], chart.rays[known]) >= photos.enough
    known &= coherent(chart, np.where(known, distance, np.nan))
    known = large_pieces(known, np.ones(known.shape), LEAST * known.size)
    if not known.any():
        return field, None
    # A knot stands by itself: no head is fitted to it, and the closed sides do not begin at it.
    knotted = widened(surface.knots > 0, KNOT)
    head = None if fit_head is None else _fitted(
        fit_head, surface, capture, np.where(known & ~knotted, distance, np.nan))
    known = ~large_pieces(~known, np.ones(known.shape), LEAST * known.size)
    # At the outlines photos look along the surface: each locates it badly, all together well.
    rim = ~known & finite & (np.abs(np.where(finite, distance, 0) - surface.distance)
                             < APART / chart.scale)
    rim[rim] = photos.seen(chart.points(distance)[rim]) > 0
    rim = without_crumbs(rim, known, chart)
    guess = _Guess(surface.distance, np.where(known, SURE, np.where(rim, RIM, 0.0)), known,
                   np.full(known.shape, LOOSE), np.full(known.shape, -np.inf), None)
    if head is not None:
        faced = known & finite & (_confidence(surface.facing) > YIELDS)
        ears = ears_of(head, chart, photos,
                       skin_by_color(chart, surface.distance, colors, faced))
        skull = head_distance(head, chart, surface.distance)
        skull = with_sloping_neck(with_hair(skull, chart, distance, faced & ~knotted), surface)
        guess = _led(guess, skull, surface, distance, ears)
    base, known = guess.base, guess.known
    shown = (guess.trust > 0) & finite & ~knotted
    ratio = np.asarray(np.log(np.where(shown, distance, base) / base), np.float64)
    whole = base * np.exp(fitted_plate(ratio, np.where(knotted, 0.0, guess.trust), 0.5, 0.01,
                                        guess.tension))
    gap = ~known
    beside = np.zeros(gap.shape, bool) if guess.ears is None else _ear_cells(chart, guess.ears)
    whole = np.maximum(whole, surface.knots)
    area = whole ** 2 * np.cos(chart.elevation)[:, None]
    whole = behind_what_is_seen(chart, whole, gap, photos, nearly=False)
    # An ear stands out of what a chart can hold.
    whole = filling_outlines(chart, whole, gap & ~(beside | _about_ears(chart, head)), photos)
    normal = normals_of(chart, smoothed(whole, np.ones_like(known), 1.0))
    cosine = np.maximum((normal * chart.rays).sum(axis=-1), 0.3)
    # Behind the ears that an arc shows lies what lies above them: hair.
    upwards = np.interp(chart.axis[:, 1], (NAPE - 0.05, NAPE + 0.05), (0.03, 1.0))
    well = shown_well(chart, chart.points(np.where(finite, distance, whole)), known & finite,
                      photos)
    hair, own = hair_cells(chart, whole, colors, well)
    # Where photos look along a surface they know its colors better than what was trained.
    there = finite & ~beside & (np.abs(np.where(finite, distance, 0) - whole) * cosine < ON * voxel)
    if hair is not None:
        there &= ~hair
    colors, share = photo_colors(photos, chart, whole, np.nan_to_num(colors), np.asarray(there))
    own |= share > SURELY
    bare = np.broadcast_to((chart.axis[:, 1] > NECK)[:, None], gap.shape)
    paint = np.clip(continued_in_shade(colors, own, upwards, hair, bare, normal), 0, 1)
    shell = Shell(chart, whole, cosine, paint, ndimage.binary_dilation(gap, np.ones((3, 3))), voxel,
                  guessed=True, ears=guess.ears, yields=guess.yields,
                  fringe=FRINGE if head is None else NARROW_FRINGE)
    closed, count = with_shell(field, shell, photos, cut)
    grazed = Grazed(chart, whole, faced_by(chart, whole, photos.cameras, hair), guess.ears, beside,
                    hair, cut, photos, gap, paint)
    return closed, Closed(float((area * gap).sum() / area.sum()), count, grazed)


@dataclass(frozen=True)
class _Guess:
    """How a surface goes on where photos do not show it."""

    base: Float64  # Distances [V, U] that it is in proportion to.
    trust: Float64  # How far what was trained tells where it lies, [V, U].
    known: Bool  # Where what was trained stays, [V, U].
    tension: Float64  # Pull towards the base, [V, U].
    yields: Float64  # Where what was trained goes, whatever sees it (`Shell.yields`), [V, U].
    ears: Ears | None  # Solids beside it, or None.


def _led(guess: _Guess, base: Float64, surface: HeadSurface, distance: Float64,
         ears: Ears | None) -> _Guess:
    """A guess that follows a fitted head at distances ``base`` [V, U] instead of a bust.

    What only slanting rays saw has less weight the more they slant, and none where it is far from
    the head's skin; hair may be thick.
    """
    chart = surface.chart
    sure = _confidence(surface.facing)
    trust = np.where(guess.known, np.maximum(SURE * sure ** 2, RIM), guess.trust)
    skin = (chart.axis[:, 1] > NECK)[:, None] & ~usual_hair(chart, base)
    skin &= np.abs(chart.angle) < SIDES
    away = np.abs(np.where(np.isfinite(distance), distance, base) - base) * chart.scale
    likely = np.clip(1.0 - (away / UNLIKELY) ** 2, 0, 1) ** 2
    doubted = skin & (sure < YIELDS)
    trust = np.where(doubted, trust * likely, trust)
    hidden = skin & ~guess.known & (surface.facing < HIDDEN)
    trust[hidden] = 0.0
    known = guess.known & (sure > YIELDS) & (trust > 0)
    yields = np.where(hidden | (doubted & (likely < 0.5)), STANDS_OUT, -np.inf)
    if ears is not None:
        beside = _ear_cells(chart, ears)
        trust[beside], known[beside], yields[beside] = 0.0, False, EAR_STANDS_OUT
    return _Guess(base, trust, known, np.where(skin, FOLLOWS, LAX), yields, ears)


def with_hair(skull: Float64, chart: Chart, distance: Float64, shown: Bool) -> Float64:
    """Distances [V, U] of a fitted skull with hair on it, as thick as photos show it beside.

    A fitted head has no hair. Where photos show none either, it goes on from what they show as a
    membrane, and gets thinner towards the nape.

    Parameters
    ----------
    skull, chart : Distances [V, U] of the fitted head, world units.
    distance : Of what was trained, [V, U]; NaN where there is nothing.
    shown : bool [V, U], where photos show it well.
    """
    hair = usual_hair(chart, skull)
    shown = shown & hair & np.isfinite(distance)
    if not shown.any():
        return skull
    thick = smoothed(np.where(shown, np.log(np.where(shown, distance, 1.0) / skull), 0.0), shown,
                     _EVENLY)
    # At the crown rows are short circles, all of whose columns are neighbours.
    upwards = np.maximum(np.cos(chart.elevation), _SHORTEST) ** 2
    thick = continued(np.where(shown, thick, 0.0)[..., None], shown, upwards=upwards,
                      apart=hair)[..., 0]
    height = heights_of(chart, skull)
    beside = shown & (np.abs(chart.angle) > _BESIDE_FACE)
    taper = np.interp(height, _ends_of_hair(thick, height, beside), (0.0, 1.0))
    return np.asarray(np.where(hair, skull * np.exp(taper * thick), skull), np.float64)


def _ends_of_hair(thick: Float64, height: Float64, beside: Bool) -> tuple[float, float]:
    """Heights, portrait units, between which hair becomes thick behind: bulky hair hangs lower.

    Of cells [V, U], ``thick`` is how thick hair is (logarithm of the distance over the skull's),
    and ``beside`` where photos show it beside a face. The lowest fifth of that tells.
    """
    if not beside.any():
        return _THICKENS[0]
    low = beside & (height <= np.quantile(height[beside], 0.2))
    bulky = float(np.interp(np.median(thick[low]), _BULKY, (0.0, 1.0)))
    flat, full = np.array(_THICKENS)
    lowest, highest = flat + bulky * (full - flat)
    return float(lowest), float(highest)


def without_crumbs(rim: Bool, known: Bool, chart: Chart) -> Bool:
    """Cells [V, U] at outlines, without pieces of one or two that hang together with nothing.

    Behind next to nothing else tells where a head lies: a single one would lift half of it. Rays
    along shoulders meet only crumbs: there all stay.
    """
    body = (chart.axis[:, 1] < NECK)[:, None]
    return rim & (body | large_pieces(rim | known, np.ones(known.shape), CRUMB))


def with_sloping_neck(skull: Float64, surface: HeadSurface) -> Float64:
    """Distances [V, U], world units, of a fitted head whose neck widens as outlines show it.

    A fitted head ends in a narrow tube. The surface that a field started from touches the outlines
    at the sides: below the jaw it is followed there where it is wider, and less and less behind.
    """
    chart = surface.chart
    aside = np.interp(np.degrees(np.abs(chart.angle)), *_BESIDE_NECKS)
    share = np.interp(chart.axis[:, 1], *_BELOW_JAWS)[:, None] * aside
    return np.asarray(skull + share * np.maximum(surface.distance - skull, 0.0), np.float64)


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


def _about_ears(chart: Chart, head: FittedHead | None) -> Bool:
    """Cells of a chart near a fitted head's ears, whether photos show these or not, [V, U].

    Without such a head: where most heads have ears.
    """
    if head is not None and head.ears.any():
        return _cells_about(chart, *cells_of(chart, head.points[head.ears])[:2], ABOUT_EARS)
    low, high, begin = EARS
    height, aside = chart.axis[:, 1], np.degrees(np.abs(chart.angle))
    usual = (height > low) & (height < high) & (chart.elevation == 0)
    return widened(usual[:, None] & (aside > begin) & (aside < _EARS_END), ABOUT_EARS)


def _ear_cells(chart: Chart, ears: Ears) -> Bool:
    """Cells of a chart whose rays meet ears, and those next to them, [V, U]."""
    row, column = np.rint(chart.places(ears.points[ears.own])[0]).astype(np.int64)
    return _cells_about(chart, row, column, 1)


def _cells_about(chart: Chart, row: Int64, column: Int64, by: int) -> Bool:
    """Cells of a chart in rows and columns [N] of it, and up to so many beside them, [V, U]."""
    found = np.zeros((len(chart.axis), len(chart.angle)), bool)
    inside = (row >= 0) & (row < len(found))
    found[row[inside], column[inside] % found.shape[1]] = True
    return widened(found, by)
