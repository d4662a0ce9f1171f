"""Charts of a head's surface: views from all around; each point belongs to one of them.

One unwrapping of a head tears or folds somewhere: behind the ears, under nose and chin, at a bun.
So the surface is looked at from a few directions, by cameras so far away that they hardly see
perspective. A point belongs to the chart that its surroundings face most, among those that see it;
"surroundings" are the normals of the head's large shape, so that the borders are smooth lines and
no wrinkle changes hands. The charts lie side by side in one atlas, cut down to what they own and a
margin in which they show what their neighbours own.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from ...arrays import Bool, Float32, Float64, Int32, Int64, UInt8
from ...capture import Camera
from ...errors import UserError
from ...field import VoxelField
from ..kernels.atlas import (
    find_owners,
    fringe,
    lift_points,
    locate,
    smooth_normals,
    sum_normals,
    surface_normals,
)
from ..patches import settled

DIRECTIONS = ((0.0, 5.0), (60.0, 5.0), (-60.0, 5.0), (120.0, 0.0), (-120.0, 0.0), (180.0, 0.0),
              (0.0, 72.0), (0.0, -48.0))
"""Yaw and pitch of the charts in degrees, 0 = from the front."""
FRONT = 0.45  # Added to the cosine of the front chart: the face stays on it.
DISTANCE = 14.0  # Of the cameras from the middle, in units of the portrait frame.
MARGIN = 24  # Pixels around what a chart owns.
ALIGN = 16  # Charts begin at multiples of this many pixels, for the pyramids.
REACH = 1.6  # What lies further from the middle than this, in world units, is not looked at.
SPARSE = 3  # Normals of the large shape are computed at every Nth pixel.
CELL = 0.055  # Side of the cells in which normals are collected for the large shape, world units.


@dataclass(frozen=True)
class Shape:
    """The large shape of a head: smoothed normals on a grid."""

    normals: Float32  # float32 [Z, Y, X, 3], not of unit length.
    low: Float64  # float64 [3], corner of the first cell.
    cell: float  # Side of a cell.

    def at(self, points: NDArray[np.floating]) -> Float32:
        """Unit normals of the large shape at points [..., 3], float32."""
        flat = np.ascontiguousarray(np.nan_to_num(points), np.float32).reshape(-1, 3)
        out = np.empty_like(flat)
        smooth_normals(flat, self.normals, self.low, self.cell, out)
        return out.reshape(points.shape)


@dataclass(frozen=True)
class Atlas:
    """Charts side by side; sizes in pixels, places in the world."""

    cameras: Camera  # One a chart.
    # int64 [C, 6]: the columns and rows x0, y0, x1, y1 of a chart that the atlas holds, and where
    # in the atlas the chart's pixel (0, 0) lies.
    boxes: Int64
    depth: Float32  # float32 [H, W], along the chart's axis; infinite where there is no surface.
    # [H, W, 3], the head as it is, sRGB: float32 in [0, 1], or uint8; or what gives it, where it is
    # in a file and not read yet.
    shown: Float32 | UInt8 | Callable[[], UInt8]
    # int32 [H, W]: flat index of the pixel that owns the surface point here, itself where it does;
    # beside the surface, within `MARGIN`, that of a near one, else -1.
    owner: Int32
    shape: Shape  # Normals of the large shape.

    @functools.cached_property
    def _picture(self) -> Float32 | UInt8:
        """``shown``, read."""
        return self.shown() if callable(self.shown) else self.shown

    @property
    def color(self) -> Float32:
        """The head as it is, float32 [H, W, 3], sRGB in [0, 1]; not kept, as it is large."""
        return self.color_of(...)

    def color_of(self, part: Any) -> Float32:
        """The same of a part: an index of an array [H, W]."""
        shown = self._picture[part]
        if shown.dtype == np.uint8:
            return np.asarray(shown.astype(np.float32) / np.float32(255))
        return np.asarray(shown, np.float32)

    @functools.cached_property
    def points(self) -> Float32:
        """Places in the world, float32 [H, W, 3]; NaN without surface."""
        points = np.full((*self.depth.shape, 3), np.nan, np.float32)
        for row, (x0, y0, x1, y1, dx, dy) in zip(self.rows, self.boxes.tolist()):
            there = slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)
            part = np.empty((y1 - y0, x1 - x0, 3), np.float32)
            camera = row.copy()
            camera[14:] -= (x0, y0)
            lift_points(np.ascontiguousarray(self.depth[there]), camera, part)
            points[there] = part
        return points

    @functools.cached_property
    def own(self) -> Bool:
        """Pixels that own their surface point, bool [H, W]."""
        return np.asarray(self.owner.reshape(-1) == np.arange(self.owner.size, dtype=np.int32)
                          ).reshape(self.owner.shape)

    @property
    def rows(self) -> Float64:
        """The cameras as the kernels take them, float64 [C, 16]."""
        return np.stack([self.cameras.row(n) for n in range(len(self.cameras))])

    @property
    def bias(self) -> Float64:
        """What is added to a chart's cosine, float64 [C]."""
        return np.where(np.arange(len(self.cameras)) == 0, FRONT, 0.0)

    def locate(self, points: Float32, before: float, behind: float) -> tuple[Float32, Float32]:
        """Places of points in the atlas.

        Parameters
        ----------
        points : float32 [N, 3] in the world.
        before, behind : How far before a chart's surface, and under it, a point may lie, in
            world units.

        Returns
        -------
        places : float32 [N, 2], (x, y) in pixels of the atlas; NaN where no chart shows the
            point.
        depth : float32 [N], how far it lies under the surface.
        """
        places = np.empty((len(points), 2), np.float32)
        depth = np.empty(len(points), np.float32)
        shape = self.shape
        locate(np.ascontiguousarray(points, np.float32), shape.normals, shape.low, shape.cell,
               self.rows, self.bias, self.boxes, self.depth, before, behind, places, depth)
        return places, depth


@dataclass
class _Chart:
    """One chart: its camera, and what it shows."""

    camera: Camera
    depth: Float32
    points: Float32
    color: Float32


def draw_atlas(field: VoxelField, pixels: float) -> Atlas:
    """Look at a field in the portrait frame from all around: ``pixels`` of a chart a world unit.

    Raises `UserError` if the field shows no surface.
    """
    charts = [chart for yaw, pitch in DIRECTIONS
              if (chart := _draw(field, yaw, pitch, pixels)) is not None]
    if not charts:
        raise UserError("the field is empty: no view shows anything to stylise")
    shape = _large_shape(field, charts)
    whole = [(0, 0, chart.depth.shape[1], chart.depth.shape[0]) for chart in charts]
    first = _packed(charts, whole, shape)
    spacing = field.spacing
    owner = _owners(first, 2.5 * float(spacing.mean()))
    used = [_used(owner, box) for box in first.boxes]
    kept = [n for n, part in enumerate(used) if part is not None]
    final = _packed([charts[n] for n in kept], [part for part in used if part is not None], shape)
    return replace(final, owner=_with_fringe(_moved(owner, first.boxes[kept], final)))


def _draw(field: VoxelField, yaw: float, pitch: float, pixels: float) -> _Chart | None:
    """One far view of the field, cut to what it shows; None if that is nothing."""
    focal = pixels * DISTANCE
    low, high = field.bounds
    corners = np.array([[(low, high)[a][0], (low, high)[b][1], (low, high)[c][2]]
                        for a in (0, 1) for b in (0, 1) for c in (0, 1)])
    wide = Camera.arc(np.array([yaw]), distance=DISTANCE, width=2, height=2, focal=focal,
                      pitch=pitch)
    reach = np.abs(wide.project(corners)[0][0] - 1.0).max(axis=0)
    # A head fills [-1, 1]; what a field holds far outside is not looked at.
    reach = np.minimum(reach, REACH * pixels)
    width, height = (int(2 * np.ceil(n)) for n in reach)
    # A small picture shows which part is worth drawing.
    camera = Camera(wide.pose, wide.focal, np.array([width / 2, height / 2]), np.array([width]),
                    np.array([height]))
    small = field.render(camera.scaled(0.125), 0, step=1.0)
    rows, columns = np.nonzero(small.alpha > 0.3)
    if not len(rows):
        return None
    ratio = np.array([width, height]) / np.array(small.alpha.shape[::-1])
    x0, y0 = (max(int((n.min() - 1) * r), 0) for n, r in zip((columns, rows), ratio))
    x1 = min(int((columns.max() + 2) * ratio[0]), width)
    y1 = min(int((rows.max() + 2) * ratio[1]), height)
    camera = Camera(wide.pose, wide.focal, np.array([width / 2 - x0, height / 2 - y0]),
                    np.array([x1 - x0]), np.array([y1 - y0]))
    shot = field.render(camera, 0, background=0.0, step=1.0)
    solid = np.isfinite(shot.depth) & (shot.alpha > 0.5)
    depth = np.where(solid, shot.depth, np.float32(np.inf))
    points = np.empty((*depth.shape, 3), np.float32)
    lift_points(depth, camera.row(0), points)
    color = np.clip(shot.color / np.maximum(shot.alpha, np.float32(0.5))[..., None], 0, 1)
    return _Chart(camera, depth, points, np.asarray(color, np.float32))


def _large_shape(field: VoxelField, charts: list[_Chart]) -> Shape:
    """Normals of all charts, collected in cells and smoothed."""
    low, high = np.clip(field.bounds, -REACH, REACH)
    size = np.maximum(np.ceil((high - low) / CELL).astype(int), 2)
    sums = np.zeros((*size[::-1], 3), np.float32)
    for chart in charts:
        points = np.ascontiguousarray(chart.points[::SPARSE, ::SPARSE])
        normals = np.empty(points.shape, np.float32)
        pitch = DISTANCE / float(chart.camera.focal[0, 0])
        surface_normals(points, 6.0 * SPARSE * pitch, normals)
        sum_normals(points, normals, low, CELL, sums)
    return Shape(np.ascontiguousarray(gaussian_filter(sums, (1.5, 1.5, 1.5, 0.0), truncate=3.0)),
                 low, CELL)


def _packed(charts: list[_Chart], parts: list[tuple[int, int, int, int]], shape: Shape) -> Atlas:
    """Parts (x0, y0, x1, y1) of charts side by side, in shelves; nothing is owned yet."""
    widest = max(x1 - x0 for x0, _, x1, _ in parts) + 2 * ALIGN
    area = sum((x1 - x0 + ALIGN) * (y1 - y0 + ALIGN) for x0, y0, x1, y1 in parts)
    width = max(widest, int(np.sqrt(area) * 1.1))
    width = -(-width // ALIGN) * ALIGN
    boxes = np.zeros((len(parts), 6), np.int64)
    x, y, shelf = ALIGN, ALIGN, 0
    for n in sorted(range(len(parts)), key=lambda n: parts[n][1] - parts[n][3]):
        x0, y0, x1, y1 = parts[n]
        if x + x1 - x0 + ALIGN > width:
            x, y, shelf = ALIGN, y + shelf, 0
        boxes[n] = x0, y0, x1, y1, x - x0, y - y0
        step_x, step_y = (-(-(size + ALIGN) // ALIGN) * ALIGN for size in (x1 - x0, y1 - y0))
        x, shelf = x + step_x, max(shelf, step_y)
    height = -(-(y + shelf) // ALIGN) * ALIGN
    depth = np.full((height, width), np.inf, np.float32)
    color = np.zeros((height, width, 3), np.float32)
    for chart, (x0, y0, x1, y1, dx, dy) in zip(charts, boxes.tolist()):
        there = slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)
        here = slice(y0, y1), slice(x0, x1)
        for target, source in ((depth, chart.depth), (color, chart.color)):
            target[there] = source[here]
    return Atlas(Camera.concatenate([chart.camera for chart in charts]), boxes, depth, color,
                 np.full((height, width), -1, np.int32), shape)


def _owners(atlas: Atlas, tolerance: float) -> Int32:
    """Owner of every pixel with a surface, int32 [H, W]; see `Atlas`."""
    own = np.full(atlas.depth.shape, -1, np.int8)
    for n, (x0, y0, x1, y1, dx, dy) in enumerate(atlas.boxes):
        own[y0 + dy:y1 + dy, x0 + dx:x1 + dx] = n
    owner = np.empty(own.shape, np.int32)
    shape = atlas.shape
    find_owners(atlas.points, shape.normals, shape.low, shape.cell, own, atlas.rows, atlas.bias,
                atlas.boxes, atlas.depth, tolerance, owner)
    return settled(owner)


def _used(owner: Int32, box: Int64) -> tuple[int, int, int, int] | None:
    """The part of a chart that owns anything, with a margin, in its own pixels."""
    x0, y0, x1, y1, dx, dy = (int(n) for n in box)
    there = slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)
    index = np.arange(owner.size, dtype=np.int32).reshape(owner.shape)
    own = owner[there] == index[there]
    rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
    if not len(rows):
        return None
    return (max(x0, int(columns[0]) + x0 - MARGIN), max(y0, int(rows[0]) + y0 - MARGIN),
            min(x1, int(columns[-1]) + x0 + MARGIN + 1), min(y1, int(rows[-1]) + y0 + MARGIN + 1))


def _moved(owner: Int32, before: Int64, atlas: Atlas) -> Int32:
    """Owners in another arrangement of the charts: ``before`` are their old boxes."""
    # Where each pixel of the old atlas has gone; -1: cut away.
    gone = np.full(owner.size, -1, np.int32).reshape(owner.shape)
    new_width = atlas.depth.shape[1]
    out = np.full(atlas.depth.shape, -1, np.int32)
    for (_, _, _, _, dx, dy), (x0, y0, x1, y1, ex, ey) in zip(before.tolist(),
                                                              atlas.boxes.tolist()):
        rows, columns = np.arange(y0, y1)[:, None], np.arange(x0, x1)[None]
        gone[y0 + dy:y1 + dy, x0 + dx:x1 + dx] = (rows + ey) * new_width + columns + ex
    flat = gone.reshape(-1)
    for (_, _, _, _, dx, dy), (x0, y0, x1, y1, ex, ey) in zip(before.tolist(),
                                                              atlas.boxes.tolist()):
        old = owner[y0 + dy:y1 + dy, x0 + dx:x1 + dx]
        out[y0 + ey:y1 + ey, x0 + ex:x1 + ex] = np.where(old >= 0, flat[old], -1)
    return out


def _with_fringe(owner: Int32) -> Int32:
    """Owners, also of pixels beside the surface: those of a near pixel on it."""
    out = owner.copy()
    fringe(owner, MARGIN, out)
    return out
