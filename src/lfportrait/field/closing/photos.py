"""Visibility of a field in the photos: surfaces seen, and free space."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...capture import Capture
from ...simd.threads import side_by_side
from ..geometry.chart import Chart
from ..grid import VoxelField

__all__ = ["Photos", "behind_what_is_seen"]

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

PHOTOS = 40
"""Photos, at most, that are asked what they see."""


class Photos:
    """What the training photos see of a field: its depth in each of ``most`` of them.

    Parameters
    ----------
    field, capture
        The field, and its photos.
    most
        Photos, at most, that are asked.
    pixel
        Width of a pixel at the head, in voxels.

    Attributes
    ----------
    voxel
        Of the field, world units.
    enough
        So many must see a place for it to be known: fewer see it at a grazing angle alone.
    cameras
        Those that are asked, reduced to those pixels.
    """

    def __init__(self, field: VoxelField, capture: Capture, most: int = PHOTOS,
                 pixel: float = 1.0) -> None:
        self.voxel = float(field.spacing.mean())
        views = capture.training()
        views = views[np.linspace(0, len(views) - 1, min(most, len(views))).astype(int)]
        self.enough = min(3, 1 + len(views) // 20)
        self.cameras = capture.cameras[views].scaled(
            float(np.clip(capture.cameras.pixel / (pixel * self.voxel), 0.1, 1.0)))
        self._depths = []
        for view in range(len(views)):
            alpha, depth = field.depth(self.cameras, view)
            self._depths.append(np.where(alpha > 0.5, depth, np.inf))
        # Next to an outline the surface goes back steeply, and then there is none.
        self._first, self._last, self._matter = zip(*side_by_side(
            lambda depth: (ndimage.minimum_filter(depth, 3), ndimage.maximum_filter(depth, 3),
                           ndimage.maximum_filter(np.where(np.isfinite(depth), depth, -np.inf), 3)),
            self._depths))

    def faced(self, points: Float64, least: float) -> NDArray[np.int32]:
        """How many views see points [N, 3] on a surface that faces them, int32 [N].

        ``least``: the cosine from which on it does. Fringes are steep in every view; an ear that
        stands out from a head, which was guessed without it, is not.
        """
        votes = np.zeros(len(points), np.int32)
        for sees in self.each(points, square=least):
            votes += sees
        return votes

    def seen(self, points: Float64, outwards: Float64 | None = None, least: float = 0.0,
             ) -> NDArray[np.int32]:
        """How many views see points [N, 3] on a surface, int32 [N].

        ``outwards`` [N, 3], unit: only from directions with a cosine above ``least`` to it.
        """
        votes = np.zeros(len(points), np.int32)
        for sees in self.each(points, outwards, least):
            votes += sees
        return votes

    def each(self, points: Float64, outwards: Float64 | None = None, least: float = 0.0,
             square: float = 0.0) -> list[Bools]:
        """For each view, which of the points it sees, bool [N] (`seen`, `faced`)."""
        def sees(view: int) -> Bools:
            shown, place, depth = self._shown(view, points)
            found = np.zeros(len(points), bool)
            found[shown] = ((depth > self._first[view][place] - 2.5 * self.voxel)
                            & (depth < self._matter[view][place] + 2.5 * self.voxel))
            if square > 0:
                found[shown] &= self._cosines[view][place] > square
            if outwards is not None:
                near = np.flatnonzero(found)
                away = self.cameras.position[view] - points[near]
                away /= np.linalg.norm(away, axis=1, keepdims=True)
                found[near] = (away * outwards[near]).sum(axis=1) > least
            return found

        return side_by_side(sees, range(len(self._depths)))

    @functools.cached_property
    def _cosines(self) -> list[NDArray[np.float32]]:
        """Between the way to each camera and the surface that it sees, by its depths, [H, W]."""
        return side_by_side(lambda view: _facing(self._depths[view],
                                                 float(self.cameras.focal[view, 0])),
                            range(len(self._depths)))

    def past(self, points: Float64, nearly: bool = True) -> Bools:
        """Whether views see past points [N, 3], bool [N].

        Of 20 views or more two must: one may have a notch. ``nearly``: also where they see past
        their pixels' neighbours.
        """
        last = self._last if nearly else self._depths

        def sees(view: int) -> Bools:
            shown, place, depth = self._shown(view, points)
            found = np.zeros(len(points), bool)
            found[shown] = depth < last[view][place] - 0.75 * self.voxel
            return found

        found = np.zeros(len(points), np.int32)
        for past in side_by_side(sees, range(len(self._depths))):
            found += past
        return found >= min(2, self.enough)

    def surface(self, view: int, low: Float64, high: Float64) -> tuple[Float64, Float64]:
        """Places that a view sees in a rectangle of its pixels, and the ways to it.

        Parameters
        ----------
        view
            Number of the view.
        low, high
            Corners (x, y) in pixels.

        Returns
        -------
        places, ways
            float64 [P, 3] each, the ways of unit length; next to an outline nothing is told.
        """
        height, width = self._depths[view].shape
        left, top = np.clip(np.floor(low), 0, [width, height]).astype(np.int64)
        right, bottom = np.clip(np.ceil(high), 0, [width, height]).astype(np.int64)
        part = slice(top, max(bottom, top)), slice(left, max(right, left))
        depth, first, last = (maps[view][part]
                              for maps in (self._depths, self._first, self._last))
        near = np.isfinite(last)
        near[near] = last[near] - first[near] < 6 * self.voxel
        row, column = np.nonzero(near)
        pixels = np.stack([column + left, row + top], axis=1) + 0.5
        origins, rays = self.cameras.rays(view, pixels)
        ahead = self.cameras.pose[view, :3, 2]
        return origins + rays * (depth[near] / (rays @ ahead))[:, None], -rays

    def depth_at(self, view: int, points: Float64) -> tuple[Float64, Float64]:
        """Depths of those of points [N, 3] that a view shows, and of what it sees there, [M]."""
        _, place, depth = self._shown(view, points)
        return depth, np.asarray(self._depths[view][place], np.float64)

    def _shown(self, view: int, points: Float64,
               ) -> tuple[Bools, tuple[NDArray[np.int64], ...], Float64]:
        """Which points a view shows, their (row, column) and depths."""
        height, width = self._depths[view].shape
        pixels, depth = (part[0] for part in self.cameras[view].project(points))
        column, row = np.floor(pixels).astype(np.int64).T
        shown = (depth > 0) & (row >= 0) & (column >= 0) & (row < height) & (column < width)
        return shown, (row[shown], column[shown]), depth[shown]


def _facing(depth: Float64, focal: float) -> NDArray[np.float32]:
    """Cosine between rays and the surface of a depth map [H, W]; the map is inf beside it."""
    slopes = []
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            # The flatter side counts: beside a jump lies a surface, too.
            step = np.abs(np.diff(depth, axis=axis, append=np.nan))
            flatter = np.fmin(step, np.roll(step, 1, axis))
            slopes.append(np.where(np.isfinite(flatter), flatter, np.inf) * focal / depth)
        found = 1.0 / np.sqrt(1.0 + slopes[0] ** 2 + slopes[1] ** 2)
    return np.nan_to_num(found, nan=0.0).astype(np.float32)


def behind_what_is_seen(chart: Chart, distance: Float64, asked: Bools, photos: Photos,
                        nearly: bool = True) -> Float64:
    """Distances [V, U] so short, where ``asked``, that no photo sees past them (`Photos.past`)."""
    cells = np.flatnonzero(asked)
    origin = np.broadcast_to(chart.origins[:, None], (*asked.shape, 3)).reshape(-1, 3)
    rays, out = chart.rays.reshape(-1, 3), distance.copy()
    limit = out.reshape(-1)
    while len(cells):
        cells = cells[photos.past(origin[cells] + rays[cells] * limit[cells, None], nearly)]
        limit[cells] -= photos.voxel
        cells = cells[limit[cells] > photos.voxel]
    return out
