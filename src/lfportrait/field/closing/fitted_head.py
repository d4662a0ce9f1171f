"""A head that was fitted to a capture, as a closing uses it: distances of its skull, and its ears.

What photos show bends it (`sides`); where they show nothing, its skull, jaw and neck go on. Its
ears stand out from what a chart can hold (`lfportrait.field.geometry.chart`): they are solids of
their own.

A sweep from the front sees an ear's rim and hollow at grazing angles, and nothing of what is
behind. What photos see there that stands out of the skull and has the skin's color is the ear. If
both of its ends lie higher than the model's, or both lower, that is made to end there. Then it is
laid on what is seen (iterated closest points with a similarity that stays near none, Besl and McKay
1992). What is hidden behind hair, or is past the mattes of most photos, is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ...arrays import Bool, Float64, Int32, Int64
from ...measure import usable_cores
from ..geometry.chart import Chart, fitted_plate
from .photos import Photos

STEP = 0.006  # Distance of a mesh's samples, portrait units.
FACING = 0.2
"""Cosine between a chart's ray and a surface from which on that surface is what the ray meets."""
LAYER = 0.04
"""Surfaces further within than this, portrait units, are others, which the first hides."""

GIVES_WAY = 1e-3
"""Pull towards what lies around where a head has no surface: in some five cells it is reached."""


@dataclass(frozen=True)
class FittedHead:
    """A mesh in the portrait frame."""

    points: Float64  # float64 [N, 3].
    triangles: Int32  # int32 [T, 3], counter-clockwise seen from outside.
    ears: Bool  # bool [N], which of the points are the ears'.


FitHead = Callable[[Float64, Float64, Float64, Float64], FittedHead | None]
"""Fits a head to landmarks [68, 3] and to places of a surface, [N, 3], with their outward unit
normals [N, 3] and how far each is to be trusted [N], 0 to 1; all in the portrait frame. None where
there is no model of heads."""


def mesh_samples(points: Float64, triangles: Int32, step: float = STEP,
                 ) -> tuple[Float64, Float64, Int64]:
    """Places on a mesh about ``step`` apart.

    Returns
    -------
    places, normals, triangle : float64 [S, 3] each, the normals outwards and of unit length,
        those of the triangles; and the triangle of each, [S].
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
    head : In the frame of the chart.
    around : Distances [V, U] to go over into where the head has no surface, below its neck.
    """
    places, normals, triangle = mesh_samples(head.points, head.triangles)
    ear = np.asarray(head.ears[head.triangles].any(axis=1))
    skull = ~ear[triangle]
    row, column, away = cells_of(chart, places)
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


def cells_of(chart: Chart, places: Float64) -> tuple[Int64, Int64, Float64]:
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


REACH = 0.05  # Portrait units from an ear's surface up to which its distance is known (1 cm).
_NEAR = 0.035  # Photos' surface this near to the model's ear is the ear's, portrait units.
_ABOUT, _STANDS = 0.12, 0.03
"""What photos see so near to an ear, and so far outside of the skull, portrait units, is it."""
_ENDS = 0.05  # Share of the ear's places below its lower end, and above its upper.
_HIGHER, _LARGER = 0.08, 0.25
"""Portrait units by which an ear is moved up or down, and logarithm by which it grows, at most."""
_BESIDE = 4  # Pixels further around an ear that are looked at.
_SHIFT, _TURN, _SIZE = 0.02, np.radians(8.0), 0.08
"""Deviations of an ear's place (portrait units), attitude and size (logarithm) on the model."""
_NOISE, _COUNT = 0.008, 60.0
"""Deviation of the photos' surface, portrait units, and how many of its places count."""
_LEAST = 60  # Places of the surface from which on an ear is moved.
_ROUNDS = 8
_HIDDEN = 0.05  # Matter so far before an ear, portrait units, hides it.
_SHOWN = 0.3
"""Share of an ear's places that the half of an arc that shows most must show for it to be there."""
_WHOLE = 0.6
"""Share of these places at which photos see matter all around, of a whole ear: 0.84 to 0.91 in two
films."""
_MATTER = 0.7  # Share of the photos that see a place of an ear whose mattes must have matter there.
_FRONT = 0.25  # Cosine from which on photos see a place of an ear well.
_ALIKE = 12  # Places that photos show, near one of an ear, whose median is its color.
_VIEWS = 12


@dataclass(frozen=True)
class Ears:
    """Solids beside a chart's surface."""

    # points, normals: float64 [N, 3] each, samples of the surface in the world; those around the
    # ears, too.
    points: Float64
    normals: Float64
    own: Bool  # bool [N], which of the samples are the ears'.
    # Boxes [E, 2, 3] about those ears (lowest and highest corner, world) of which what was trained
    # has only shreds.
    torn: Float64
    tree: cKDTree  # Of the points.
    reach: float  # World units up to which distances are known.
    step: float  # World units between samples.
    # float64 [N, 3], sRGB in [0, 1], as photos show them; None: an ear has the colors around it.
    colors: Float64 | None = None

    def distance(self, points: Float64) -> tuple[Float64, Int64]:
        """How far points [N, 3] lie outside, and their nearest samples; infinite far from ears."""
        low, high = (f(self.points[self.own], axis=0) for f in (np.min, np.max))
        near = np.flatnonzero(((points > low - self.reach) & (points < high + self.reach))
                              .all(axis=1))
        out, sample = np.full(len(points), np.inf), np.zeros(len(points), np.int64)
        length, nearest = self.tree.query(points[near], distance_upper_bound=self.reach)
        found = np.isfinite(length)
        found[found] = self.own[nearest[found]]
        near, nearest, length = near[found], nearest[found], length[found]
        along = ((points[near] - self.points[nearest]) * self.normals[nearest]).sum(axis=1)
        # Near the surface the distance from the sample's plane, which is smooth.
        share = np.clip((length / self.step - 1.0) / 2.0, 0, 1)
        out[near] = share * np.sign(along) * length + (1 - share) * along
        sample[near] = nearest
        return out, sample


    def replaced(self, points: Float64) -> Bool:
        """Where what was trained is torn, and goes: which of points [N, 3], [N]."""
        out = np.zeros(len(points), bool)
        for low, high in self.torn:
            out |= ((points > low - self.reach) & (points < high + self.reach)).all(axis=1)
        return out


IsSkin = Callable[[Float64], Bool]
"""Which of colors [N, 3], sRGB in [0, 1], are rather skin than hair, [N]."""


def ears_of(head: FittedHead, chart: Chart, photos: Photos, is_skin: IsSkin | None = None,
            ) -> Ears | None:
    """The ears of a head that photos show, or None.

    Parameters
    ----------
    head : In the frame of the chart.
    chart : Of the closed surface.
    photos : What the photos, which have mattes, see of the field.
    is_skin : What has another color is no ear; None: all colors may be an ear's.
    """
    if not head.ears.any():
        return None
    unit = 1.0 / chart.scale
    to_world = np.eye(4) if chart.frame is None else np.linalg.inv(chart.frame)
    up = to_world[:3, 1] / np.linalg.norm(to_world[:3, 1])
    vertices = head.points @ to_world[:3, :3].T + to_world[:3, 3]
    left = head.points[:, 0] > 0
    skull = _Skull.of(vertices, head.triangles[~head.ears[head.triangles].any(axis=1)],
                      2 * STEP * unit)
    found, torn = [], []
    for side in (left, ~left):
        triangles = _around(head, side)
        own = np.asarray((head.ears & side)[head.triangles[triangles]].any(axis=1))
        points, normals, triangle = mesh_samples(vertices, head.triangles[triangles], STEP * unit)
        mine = own[triangle]
        about = _surface_near(photos, points[mine], _ABOUT * unit, is_skin)[0]
        begin = _as_high(points, normals, mine, photos, skull, about, unit, up)
        middle = points[mine].mean(axis=0)
        at = begin.of(points, normals, middle, np.ones((len(points), 1)))[0]
        seen = _surface_near(photos, at[mine], _NEAR * unit, is_skin)
        points, normals = _moved(points, normals, mine, seen, unit, begin)
        kept = mine & (photos.matter(points, _HIDDEN * unit) > _MATTER)
        shown, whole = _shown(photos, points[kept], normals[kept], _HIDDEN * unit)
        if shown > _SHOWN:
            found.append((points, normals, kept))
            if whole < _WHOLE:
                torn.append((points[kept].min(axis=0), points[kept].max(axis=0)))
    if not found:
        return None
    points, normals, own = (np.concatenate(part) for part in zip(*found, strict=True))
    return Ears(points, normals, own, np.reshape(torn, (-1, 2, 3)), cKDTree(points), REACH * unit,
                STEP * unit, _colors(points, normals, own, photos, is_skin))


def _colors(points: Float64, normals: Float64, own: Bool, photos: Photos, is_skin: IsSkin | None,
            ) -> Float64 | None:
    """Colors [N, 3] of ears' samples: the photos', and beside what these show the nearest ones'."""
    mine = np.flatnonzero(own)
    # As a square: a picture's rows are no longer than 32767 (`cv2.remap`).
    side = int(np.ceil(np.sqrt(len(mine))))
    square = mine[np.minimum(np.arange(side * side), len(mine) - 1)].reshape(side, side)
    found = photos.colors(points[square], normals[square], np.full((side, side, 3), np.nan))
    shown, facing = (part.reshape(side * side, -1)[:len(mine)] for part in found)
    known = facing[:, 0] > _FRONT
    if is_skin is not None:
        known[known] = is_skin(shown[known])
    if known.sum() < _LEAST:
        return None
    nearest = cKDTree(points[mine[known]]).query(points, _ALIKE, workers=usable_cores())[1]
    return np.asarray(np.median(shown[known][nearest], axis=1), np.float64)


def _around(head: FittedHead, side: Bool) -> Int64:
    """The triangles of an ear and next to it."""
    mark = head.ears & side
    for _ in range(3):
        touched = head.triangles[mark[head.triangles].any(axis=1)]
        mark = mark.copy()
        mark[touched] = True
    return np.flatnonzero(mark[head.triangles].all(axis=1))


def _views(count: int) -> Int64:
    return np.linspace(0, count - 1, min(_VIEWS, count)).astype(np.int64)


@dataclass(frozen=True)
class _Skull:
    """Samples of a head without its ears, world units."""

    points: Float64  # float64 [S, 3].
    normals: Float64
    tree: cKDTree

    @classmethod
    def of(cls, vertices: Float64, triangles: Int32, step: float) -> _Skull:
        """That of a mesh, sampled in such steps."""
        points, normals, _ = mesh_samples(vertices, triangles, step)
        return cls(points, normals, cKDTree(points))

    def outside(self, points: Float64) -> Float64:
        """How far points [N, 3] lie outside, [N]."""
        nearest = self.tree.query(points)[1]
        return np.asarray(((points - self.points[nearest]) * self.normals[nearest]).sum(axis=1))


def _surface_near(photos: Photos, points: Float64, reach: float, is_skin: IsSkin | None,
                  ) -> tuple[Float64, Float64]:
    """Places of what photos see near points [N, 3], and the ways to their cameras; [P, 3] each."""
    tree, places, ways = cKDTree(points), [], []
    for view in _views(len(photos.cameras)):
        pixels, depth = (part[0] for part in photos.cameras[view].project(points))
        beside = _BESIDE + reach * float(photos.cameras.focal[view, 0]) / max(depth.min(), reach)
        place, way, colors = photos.surface(int(view), pixels.min(axis=0) - beside,
                                            pixels.max(axis=0) + beside)
        near = np.isfinite(tree.query(place, distance_upper_bound=reach)[0])
        if is_skin is not None and near.any():
            near[near] = is_skin(colors[near])
        places.append(place[near])
        ways.append(way[near])
    return np.concatenate(places), np.concatenate(ways)


@dataclass(frozen=True)
class _Move:
    """A similarity about the middle of an ear."""

    turn: Float64  # Rotation vector, [3].
    shift: Float64  # [3], world units.
    size: float  # Logarithm of a factor.

    def of(self, points: Float64, normals: Float64, middle: Float64, share: Float64,
           ) -> tuple[Float64, Float64]:
        """Points and unit normals, [N, 3] each, after a share [N, 1] of it."""
        rotation = Rotation.from_rotvec(self.turn).as_matrix()
        at = points + share * (middle + self.shift + np.exp(self.size)
                               * (points - middle) @ rotation.T - points)
        facing = normals + share * (normals @ rotation.T - normals)
        return at, facing / np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-12)


def _as_high(points: Float64, normals: Float64, own: Bool, photos: Photos, skull: _Skull,
             places: Float64, unit: float, up: Float64) -> _Move:
    """What makes an ear end where places [P, 3] around it, which photos see, end along ``up`` [3].

    Fringes make what stands out of a skull longer both upwards and downwards, hair and collars
    make it shorter: then nothing is known.
    """
    none = _Move(np.zeros(3), np.zeros(3), 0.0)
    mine = np.flatnonzero(own)
    mine = mine[skull.outside(points[mine]) > _STANDS * unit]
    ways = photos.cameras.position[_views(len(photos.cameras))][:, None] - points[mine]
    ways /= np.linalg.norm(ways, axis=2, keepdims=True)
    # As many pixels show a place as it faces them.
    shown = np.clip((ways * normals[mine]).sum(axis=2), 0, 1).sum(axis=0)
    if len(places):
        places = places[skull.outside(places) > _STANDS * unit]
    if len(places) < _LEAST or not shown.any():
        return none
    height = points[mine] @ up
    order = np.argsort(height)
    total = np.cumsum(shown[order]) / shown.sum()
    low, high = height[order[np.searchsorted(total, (_ENDS, 1 - _ENDS))]]
    lowest, highest = np.quantile(places @ up, (_ENDS, 1 - _ENDS))
    if (lowest - low) * (highest - high) <= 0:
        return none
    size = float(np.log(max(highest - lowest, 1e-9) / max(high - low, 1e-9)))
    middle = float((points[own] @ up).mean())
    by = 0.5 * (lowest + highest) - middle - np.exp(size) * (0.5 * (low + high) - middle)
    if abs(by) > _HIGHER * unit or abs(size) > _LARGER:
        return none
    return _Move(np.zeros(3), by * up, size)


def _moved(points: Float64, normals: Float64, own: Bool, seen: tuple[Float64, Float64],
           unit: float, begin: _Move) -> tuple[Float64, Float64]:
    """Samples and normals after an ear was laid over what is seen of it, from where it begins."""
    places, ways = seen
    middle = points[own].mean(axis=0)
    # Around the ear the head stays.
    away = cKDTree(points[own]).query(points)[0]
    share = np.clip(1.0 - away / (0.04 * unit), 0, 1)[:, None]
    move = begin
    at, facing = move.of(points, normals, middle, share)
    if len(places) < _LEAST:
        return at, facing
    keep = np.unique(np.floor(places / (0.5 * _NOISE * unit)).astype(np.int64), axis=0,
                     return_index=True)[1]
    places, ways = places[keep], ways[keep]
    held = 1.0 / np.concatenate([np.full(3, _TURN ** 2), np.full(3, (_SHIFT * unit) ** 2),
                                 [_SIZE ** 2]])
    for step in range(_ROUNDS):
        reach = np.interp(step, (0, _ROUNDS - 1), (_NEAR, 0.5 * _NEAR)) * unit
        length, nearest = cKDTree(at[own]).query(places, distance_upper_bound=reach)
        found = np.isfinite(length)
        mine = np.flatnonzero(own)[nearest[found]]
        towards = (facing[mine] * ways[found]).sum(axis=1) > 0.1
        mine, target = mine[towards], places[found][towards]
        if len(mine) < _LEAST:
            break
        normal = facing[mine]
        error = ((at[mine] - target) * normal).sum(axis=1)
        noise = _NOISE * unit
        weight = (np.minimum(1.0, 2 * noise / np.maximum(np.abs(error), 1e-12)) / noise ** 2
                  / max(len(mine) / _COUNT, 1.0))
        arm = at[mine] - middle - move.shift
        rows = np.concatenate([np.cross(arm, normal), normal,
                               (arm * normal).sum(axis=1)[:, None]], axis=1)
        matrix = rows.T @ (weight[:, None] * rows) + np.diag(held)
        off = np.concatenate([move.turn, move.shift - begin.shift, [move.size - begin.size]])
        right = -rows.T @ (weight * error) - held * off
        change = np.linalg.solve(matrix, right)
        turn = (Rotation.from_rotvec(change[:3]) * Rotation.from_rotvec(move.turn)).as_rotvec()
        move = _Move(turn, move.shift + change[3:6], move.size + float(change[6]))
        at, facing = move.of(points, normals, middle, share)
    return at, facing


def _shown(photos: Photos, points: Float64, normals: Float64, hidden: float,
           ) -> tuple[float, float]:
    """Share of an ear's places facing photos that nothing hides, and of these in whole matter.

    Of the half of an arc that shows most of it: a cheek hides an ear from the other. An arc sees an
    ear slantingly: that its depths jump says nothing of holes in it.
    """
    found = []
    for view in _views(len(photos.cameras)):
        way = photos.cameras.position[view] - points
        faces = (way * normals).sum(axis=1) > _FRONT * np.linalg.norm(way, axis=1)
        depth, before, around = photos.depth_at(int(view), points[faces])
        shows = depth < before + hidden
        found.append((int(shows.sum()), int((shows & around).sum()), len(depth)))
    free, whole, total = np.sum(sorted(found)[len(found) // 2:], axis=0)
    return float(free / max(total, 1)), float(whole / max(free, 1))
