"""Splats on the surface of a field, before they are fitted.

The field is looked at from all around. Where a ray's transmittance passes one half there is a
surface point; where the field is too thin for that (stray hair, the rim of a beard), one lies where
a few percent of the light are taken. A splat is the middle of all points in a small cell: a disc
along the surface, as wide as its distance to its neighbours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...capture import Camera
from ...errors import UserError
from ...field import C0, Rendering, VoxelField
from .cloud import Splats, quaternions_of

__all__ = ["Ball", "place_splats"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

LOOKS = ((0.0, 8), (40.0, 6), (-30.0, 6), (75.0, 3), (-65.0, 3))
"""Pitch in degrees and number of cameras on each ring around the head."""
DISTANCE = 3.5
"""Of the cameras from the middle, in radii of what the field holds."""
PIXEL = 1.0
"""Of their pictures, in distances between neighbouring splats."""
LARGEST = 1000
"""Side of those pictures at most, pixels."""
THIN = 12.0
"""By this factor a copy of the field is denser that shows where something thin is: where the field
itself takes 1 - 0.5^(1 / 12) = 6 % of the light."""
DEEP = 4
"""How much deeper than wide a cell is."""
FACING = 0.35
"""Where the cosine between normal and view is lower, a ray is stopped by the soft layer over the
surface: what it meets counts as thin."""
FAINT = 0.04
"""Pixels that are more transparent show no color that could be trusted."""
WIDTH = 0.48
"""Standard deviation of a disc along the surface, in distances to its neighbours."""
FLAT = 0.25
"""Its standard deviation across the surface, in those along it."""


@dataclass(frozen=True)
class _Points:
    """Surface points: places, normals and colors, float32 [K, 3], and opacities [K]."""

    places: Float32
    normals: Float32
    colors: Float32
    opacity: Float32

    def part(self, rows: NDArray[Any]) -> _Points:
        """Some of the points."""
        return _Points(self.places[rows], self.normals[rows], self.colors[rows],
                       self.opacity[rows])


@dataclass(frozen=True)
class Ball:
    """A ball around what a field holds: its middle, float64 [3], and its radius, world units."""

    middle: Float64
    radius: float

    @staticmethod
    def around(field: VoxelField) -> Ball:
        """The ball of a field.

        Raises
        ------
        UserError
            If the field is empty.
        """
        dense = field.lattice_points()[field.density > 0]
        if not len(dense):
            raise UserError("the field is empty; reconstruct it again")
        middle = (dense.min(axis=0) + dense.max(axis=0)) / 2
        away = float(np.linalg.norm(dense - middle, axis=1).max())
        return Ball(middle, away + float(field.spacing.max()))

    def seen(self, yaw: float, pitch: float, pixels: int) -> Camera:
        """A square camera that sees all of it, from angles in degrees as of `Camera.arc`."""
        focal = pixels / 2 * np.sqrt(DISTANCE ** 2 - 1)
        return Camera.arc(np.array([yaw]), distance=DISTANCE * self.radius, width=pixels,
                          height=pixels, focal=focal, target=self.middle.tolist(), pitch=pitch)


def _all_around(ball: Ball, pixels: int) -> Iterator[Camera]:
    """One camera after the other."""
    for ring, (pitch, count) in enumerate(LOOKS):
        turns = (np.arange(count) + ring % 2 / 2) * 360 / count
        yield from (ball.seen(turn, pitch, pixels) for turn in turns.tolist())


def _seen(field: VoxelField, ball: Ball, pixels: int, low: Float64, fine: float,
          ) -> tuple[_Points, _Points]:
    """Points from all around, merged in fine cells: the surface's, and those of thin matter."""
    dense = VoxelField(field.links, field.density * np.float32(THIN), field.sh[:, :, :1],
                       field.center, field.radius)
    solid, thin = [], []
    for camera in _all_around(ball, pixels):
        shot = field.render(camera, 0, background=0.0)
        hint = dense.render(camera, 0, background=0.0)
        places, outer = shot.points(camera, 0), hint.points(camera, 0)
        normals, forward = _normals(places), camera.pose[0, :3, 2]
        faced = -(normals @ forward) > FACING
        found = np.isfinite(shot.depth)
        solid.append(_merged(_points(places, normals, shot, found & faced), low, fine))
        outer[found] = places[found]
        thin.append(_merged(_points(outer, _normals(outer), shot, ~(found & faced)), low, fine))
    return _merged(_joined(solid), low, fine), _merged(_joined(thin), low, fine)


def _points(places: Float64, normals: Float32, shot: Rendering, wanted: NDArray[np.bool_],
            ) -> _Points:
    """Those of the points of a picture [H, W] that are wanted."""
    there = wanted & np.isfinite(places[..., 0]) & (shot.alpha > FAINT)
    alpha = shot.alpha[there]
    shown = np.asarray(shot.color[there] / alpha[:, None], np.float32)
    return _Points(places[there].astype(np.float32), normals[there], shown, alpha)


def _normals(places: Float64) -> Float32:
    """Vectors across a surface of points [H, W, 3]; 0 where the neighbours are missing."""
    with np.errstate(invalid="ignore"):
        right = np.full_like(places, np.nan)
        down = np.full_like(places, np.nan)
        right[:, 1:-1] = places[:, 2:] - places[:, :-2]
        down[1:-1] = places[2:] - places[:-2]
        normals = np.cross(down, right)
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return np.nan_to_num(normals).astype(np.float32)


def _joined(parts: list[_Points]) -> _Points:
    return _Points(*(np.concatenate([getattr(part, name) for part in parts])
                     for name in ("places", "normals", "colors", "opacity")))


def _cells(points: _Points, low: Float64, side: float) -> tuple[NDArray[np.int64], int]:
    """Which cell each point lies in, int64 [K], and how many cells hold any.

    Cells are square columns, `DEEP` times as deep, along the axis that a normal is nearest to: a
    surface that leans, or that views see at slightly different depths, does not fill two of them.
    """
    axis = np.abs(points.normals).argmax(axis=1)
    outwards = np.take_along_axis(points.normals, axis[:, None], axis=1)[:, 0] > 0
    size = np.where(np.arange(3) == axis[:, None], DEEP * side, side)
    index = np.floor((points.places - low) / size).astype(np.int64)
    number = 2 * axis + outwards
    for column in index.T:
        number = (number << 20) + column
    known, cell = np.unique(number, return_inverse=True)
    return cell.reshape(-1), len(known)


def _merged(points: _Points, low: Float64, side: float) -> _Points:
    """One point for each cell, the mean of those in it."""
    if not len(points.places):
        return points
    cell, count = _cells(points, low, side)
    number = np.bincount(cell, minlength=count).astype(np.float64)[:, None]

    def mean(values: Float32) -> Float32:
        columns = values.reshape(len(values), -1)
        sums = np.stack([np.bincount(cell, column, count) for column in columns.T], axis=1)
        return (sums / number).astype(np.float32).reshape(count, *values.shape[1:])

    return _Points(mean(points.places), mean(points.normals), mean(points.colors),
                   mean(points.opacity))


def place_splats(field: VoxelField, count: int, degree: int | None = None) -> Splats:
    """Flat splats on the surface of a field.

    Parameters
    ----------
    field
        The field.
    count
        How many at most.
    degree
        Of their spherical harmonics; by default the field's.

    Raises
    ------
    UserError
        If the field shows no surface.
    """
    ball = Ball.around(field)
    # A ball has this area for each splat; heads have less or more, which the search finds out.
    pitch = ball.radius * float(np.sqrt(4 * np.pi / count))
    pixels = int(np.clip(np.ceil(2.2 * ball.radius / (PIXEL * pitch)), 64, LARGEST))
    low = field.bounds[0] - 1e-3
    solid, thin = _seen(field, ball, pixels, low, 0.25 * pitch)
    if not len(solid.places) + len(thin.places):
        raise UserError("the field shows nothing to be exported as splats; reconstruct it again")
    side = _side(_joined([solid, thin]), low, 0.25 * pitch, count, 4 * ball.radius)
    chosen = _chosen(field, solid, thin, low, side)
    # A cell may hold one point of each kind.
    while len(chosen.places) > count and side < 4 * ball.radius:
        side *= 1.005
        chosen = _chosen(field, solid, thin, low, side)
    # Even one cell as large as the head holds a point for each side of it.
    few = np.linspace(0, len(chosen.places), min(count, len(chosen.places)), endpoint=False)
    chosen = chosen.part(few.astype(np.int64))
    return _discs(chosen, side, field.basis if degree is None else (degree + 1) ** 2)


def _side(points: _Points, low: Float64, least: float, count: int, largest: float) -> float:
    """The smallest side of cells of which at most ``count`` hold points, within a percent."""
    most = least
    while most < largest and _cells(points, low, most)[1] > count:
        least, most = most, 2 * most
    while most > 1.01 * least:
        middle = float(np.sqrt(least * most))
        if _cells(points, low, middle)[1] > count:
            least = middle
        else:
            most = middle
    return most


def _chosen(field: VoxelField, solid: _Points, thin: _Points, low: Float64, side: float,
            ) -> _Points:
    """Points of the surface, and those of thin matter that are not close to it.

    What is thin was seen along the surface, where it hides most. It is as opaque as the field is on
    a way as long as a cell.
    """
    from scipy.spatial import cKDTree

    solid, thin = (_merged(points, low, side) for points in (solid, thin))
    if not len(thin.places) or not len(solid.places):
        return solid if len(solid.places) else thin
    away, _ = cKDTree(solid.places).query(thin.places, distance_upper_bound=side)
    free = np.isinf(away)
    opacity = -np.expm1(-side * _density(field, thin.places[free]))
    return _joined([solid, replace(thin.part(free), opacity=opacity.astype(np.float32))])


def _density(field: VoxelField, places: Float32) -> Float32:
    """The field's density at the lattice points next to places [K, 3], float32 [K]."""
    size = np.array(field.links.shape[::-1])
    x, y, z = np.clip(np.rint(((places - field.center) / field.radius + 1) * size / 2 - 0.5),
                      0, size - 1).astype(np.int64).T
    rows = field.links[z, y, x]
    return np.where(rows >= 0, np.maximum(field.density[rows], 0), np.float32(0))


def _discs(points: _Points, side: float, basis: int) -> Splats:
    """Discs at points, as wide as their distance to their neighbours."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points.places)
    near, around = tree.query(points.places, k=min(7, len(points.places) + 1))
    near, around = near.reshape(len(points.places), -1), around.reshape(len(points.places), -1)
    near[~np.isfinite(near)] = side
    width = np.clip(near[:, 1:5].mean(axis=1) if near.shape[1] > 1 else side, 0.3 * side, 2 * side)
    around = np.where(around < len(points.places), around, np.arange(len(around))[:, None])
    normals = points.normals[around].mean(axis=1)
    scales = np.stack([width * WIDTH, width * WIDTH, width * WIDTH * FLAT], axis=1)
    sh = np.zeros((len(points.places), 3, basis), np.float32)
    sh[:, :, 0] = (points.colors - 0.5) / C0
    return Splats(points.places, scales.astype(np.float32), quaternions_of(_frames(normals)),
                  np.clip(points.opacity, 0.02, 0.95).astype(np.float32), sh)


def _frames(normals: Float32) -> Float32:
    """Rotation matrices [N, 3, 3] whose third column is the normal."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    third = np.where(length > 1e-6, normals / np.maximum(length, 1e-6), np.array([0, 0, 1]))
    helper = np.where(np.abs(third[:, 1:2]) < 0.9, np.array([0, 1, 0]), np.array([1, 0, 0]))
    first = np.cross(helper, third)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(third, first), third], axis=2).astype(np.float32)
