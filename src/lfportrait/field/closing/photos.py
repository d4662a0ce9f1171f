"""What photos see of a field: surfaces, free space, and from how many directions.

Held-out photos lie between the others, so they say little about what an arc of photos does not
show. A place that is seen from three directions or more has its shape from the photos; one that is
seen from none is a guess (`Coverage`).
"""

from __future__ import annotations

import functools

import cv2
import numpy as np
from scipy import ndimage

from ...arrays import Bool, Float32, Float64, Int32, Int64, UInt8
from ...capture import Camera, Capture
from ...simd.threads import side_by_side
from ..geometry.chart import Chart
from ..grid import VoxelField, surface_points
from ..kernels.depth_maps import places_shown

PHOTOS = 40  # Photos, at most, that are asked what they see.
GRAZED, SQUARE = 0.1, 0.6
"""Cosines to a surface from which on a photo says what color it has, and how bright the photo is
over the others."""
SHARPLY = 4.0
"""Power of a cosine, over that of the third best photo, that a photo's color counts with."""
OUTLIER = 0.05  # A color so far from those of the other photos (sRGB in [0, 1]) counts half.
EDGE, WITHIN = 3, 0.99
"""Pixels by which mattes are made smaller, wall and person being mixed beside their edges, and
their least value within."""

STEEPEST = 6.0
"""Voxels between the depths of a pixel's neighbours up to which they are one surface."""
APART, NEXT = 2.5, 2.0
"""What lies so much nearer beside a place hides it: voxels, and pixels along its surface."""

_NO_MAP, _NO_WAYS = np.zeros((0, 0), np.float32), np.zeros((0, 3))


class Photos:
    """What the training photos see of a field: its depth in each of ``most`` of them.

    Parameters
    ----------
    field, capture : The field, and its photos.
    most : Photos, at most, that are asked.
    pixel : Width of a pixel at the head, in voxels.

    Attributes
    ----------
    voxel : Of the field, world units.
    enough : So many must see a place for it to be known: fewer see it at a grazing angle alone.
    cameras : Those that are asked, reduced to those pixels.
    """

    def __init__(self, field: VoxelField, capture: Capture, most: int = PHOTOS,
                 pixel: float = 1.0) -> None:
        self.voxel = float(field.spacing.mean())
        views = capture.training()
        views = views[np.linspace(0, len(views) - 1, min(most, len(views))).astype(int)]
        self.enough = min(3, 1 + len(views) // 20)
        self.cameras = capture.cameras[views].scaled(
            float(np.clip(capture.cameras.pixel / (pixel * self.voxel), 0.1, 1.0)))
        self._views, self._capture = views, capture
        self._depths = []
        for view in range(len(views)):
            alpha, depth = field.depth(self.cameras, view)
            self._depths.append(np.where(alpha > 0.5, depth, np.inf))
        # Next to an outline the surface goes back steeply, and then there is none.
        self._first, self._last, self._matter = zip(*side_by_side(
            lambda depth: (ndimage.minimum_filter(depth, 3), ndimage.maximum_filter(depth, 3),
                           ndimage.maximum_filter(np.where(np.isfinite(depth), depth, -np.inf), 3)),
            self._depths))

    def faced(self, points: Float64, least: float) -> Int32:
        """How many views see points [N, 3] on a surface that faces them, int32 [N].

        ``least``: the cosine from which on it does. Fringes are steep in every view; an ear that
        stands out from a head, which was guessed without it, is not.
        """
        votes = np.zeros(len(points), np.int32)
        for sees in self.each(points, square=least):
            votes += sees
        return votes

    def seen(self, points: Float64, outwards: Float64 | None = None, least: float = 0.0) -> Int32:
        """How many views see points [N, 3] on a surface, int32 [N].

        ``outwards`` [N, 3], unit: only from directions with a cosine above ``least`` to it.
        """
        votes = np.zeros(len(points), np.int32)
        for sees in self.each(points, outwards, least):
            votes += sees
        return votes

    def each(self, points: Float64, outwards: Float64 | None = None, least: float = 0.0,
             square: float = 0.0) -> list[Bool]:
        """For each view, which of the points it sees, bool [N] (`seen`, `faced`)."""
        slack = (np.float32(2.5 * self.voxel),) * 2

        def sees(view: int) -> Bool:
            return self._between(view, points, self._first[view], self._matter[view], slack,
                                 square, outwards, least)

        return side_by_side(sees, range(len(self._depths)))

    @functools.cached_property
    def _cosines(self) -> list[Float32]:
        """Between the way to each camera and the surface that it sees, by its depths, [H, W]."""
        return side_by_side(lambda view: _facing(self._depths[view],
                                                 float(self.cameras.focal[view, 0])),
                            range(len(self._depths)))

    def past(self, points: Float64, nearly: bool = True, share: float = 0.0) -> Bool:
        """Whether views see past points [N, 3], bool [N].

        Of 20 views or more two must: one may have a notch. ``nearly``: also where they see past
        their pixels' neighbours. ``share``: of all views, which must at least.
        """
        last = self._last if nearly else self._depths

        def sees(view: int) -> Bool:
            return self._between(view, points, last[view], last[view],
                                 (np.float32(-1), np.float32(-0.75 * self.voxel)))

        found = np.zeros(len(points), np.int32)
        for past in side_by_side(sees, range(len(self._depths))):
            found += past
        return found >= max(min(2, self.enough), share * len(self._depths))

    def _between(self, view: int, points: Float64, nearest: Float32, farthest: Float32,
                 slack: tuple[np.float32, np.float32], square: float = 0.0,
                 outwards: Float64 | None = None, least: float = 0.0) -> Bool:
        """Which points a view shows at such depths (`places_shown`), bool [N].

        ``slack``: how far before the nearest and beyond the farthest, world units.
        """
        shown = np.empty(len(points), bool)
        places_shown(np.ascontiguousarray(points, np.float64), self.cameras.row(view),
                     nearest, farthest, *slack,
                     self._cosines[view] if square > 0 else _NO_MAP, float(square),
                     _NO_WAYS if outwards is None else np.ascontiguousarray(outwards, np.float64),
                     float(least), shown)
        return shown

    def surface(self, view: int, low: Float64, high: Float64,
                ) -> tuple[Float64, Float64, Float32]:
        """Places that a view sees in a rectangle of its pixels, the ways to it, and their colors.

        Parameters
        ----------
        view : Number of the view.
        low, high : Corners (x, y) in pixels.

        Returns
        -------
        places, ways, colors : float64 [P, 3] each, the ways of unit length, and float32 [P, 3],
            sRGB in [0, 1]; next to an outline nothing is known.
        """
        height, width = self._depths[view].shape
        left, top = np.clip(np.floor(low), 0, [width, height]).astype(np.int64)
        right, bottom = np.clip(np.ceil(high), 0, [width, height]).astype(np.int64)
        part = slice(top, max(bottom, top)), slice(left, max(right, left))
        depth, first, last = (maps[view][part]
                              for maps in (self._depths, self._first, self._last))
        near = self._even(first, last)
        row, column = np.nonzero(near)
        pixels = np.stack([column + left, row + top], axis=1) + 0.5
        origins, rays = self.cameras.rays(view, pixels)
        ahead = self.cameras.pose[view, :3, 2]
        return (origins + rays * (depth[near] / (rays @ ahead))[:, None], -rays,
                self._picture(view)[0][part][near])

    def colors(self, points: Float64, outwards: Float64, given: Float64,
               ) -> tuple[Float64, Float64]:
        """The colors that photos show at places of a surface, and how squarely they look at it.

        The photos that look most squarely count most, and those that differ from them little.

        Parameters
        ----------
        points, outwards : float64 [V, U, 3] each: places, and the surface's unit normals there.
        given : float64 [V, U, 3], colors of the field, which tell how bright each photo is; NaN
            where there are none.

        Returns
        -------
        colors, facing : float64 [V, U, 3] and [V, U]; the third largest cosine between the
            normals and the ways to the photos that see a place, 0 where fewer than three do.
        """
        sees = self.each(points.reshape(-1, 3), outwards.reshape(-1, 3), GRAZED)
        shown, cosines = (np.stack(part) for part in zip(*side_by_side(
            lambda view: self._looked_up(view, points, outwards, given,
                                         sees[view].reshape(points.shape[:2])),
            range(len(self._views)))))
        facing = (np.sort(cosines, axis=0)[-3] if len(cosines) > 2
                  else np.zeros(points.shape[:2]))
        share = np.minimum(cosines / np.maximum(facing, GRAZED), 1.0) ** SHARPLY
        weights, out = share, np.zeros(points.shape)
        for _ in range(3):
            total = np.maximum(weights.sum(axis=0), 1e-9)
            out = (weights[..., None] * shown).sum(axis=0) / total[..., None]
            weights = share / (1.0 + (np.abs(shown - out).mean(axis=-1) / OUTLIER) ** 2)
        return np.asarray(out, np.float64), np.asarray(facing, np.float64)

    def _looked_up(self, view: int, points: Float64, outwards: Float64, given: Float64,
                   sees: Bool) -> tuple[Float32, Float32]:
        """A photo's colors at points, as bright as ``given``, and cosines [V, U], or 0."""
        picture, matte = self._picture(view)
        pixels, depth = (part[0] for part in self.cameras[view].project(points.reshape(-1, 3)))
        x, y = (pixels.astype(np.float32) - 0.5).reshape(*points.shape[:2], 2).transpose(2, 0, 1)
        colors, inside = (cv2.remap(of, np.ascontiguousarray(x), np.ascontiguousarray(y),
                                    cv2.INTER_LINEAR, borderValue=0) for of in (picture, matte))
        way = self.cameras.position[view] - points
        cosine = (way * outwards).sum(axis=-1) / np.linalg.norm(way, axis=-1)
        cosine[~sees | (inside < WITHIN)] = 0.0
        # Beside the edge of a jaw or of an ear its color has run into what is behind.
        column, row = (np.clip(np.floor(part), 0, size - 1).astype(np.int64) for part, size in
                       zip(pixels.T, self._first[view].shape[::-1]))
        steep = np.sqrt(np.maximum(1.0 - cosine ** 2, 0.0)) / np.maximum(cosine, GRAZED)
        before = (depth - self._first[view][row, column]).reshape(cosine.shape)
        pixel = np.linalg.norm(way, axis=-1) / self.cameras.focal[view, 0]
        cosine[before > APART * self.voxel + NEXT * pixel * steep] = 0.0
        known = (cosine > SQUARE) & np.isfinite(given).all(axis=-1)
        if known.any():
            colors = colors * np.median(given[known] / np.maximum(colors[known], 0.02), axis=0)
        return np.asarray(colors, np.float32), np.asarray(cosine, np.float32)

    def _picture(self, view: int) -> tuple[Float32, Float32]:
        """A photo reduced to the camera's size, [H, W, 3] in [0, 1], and where it is the person."""
        size = int(self.cameras.width[view]), int(self.cameras.height[view])

        def reduced(picture: UInt8) -> Float32:
            small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
            return np.asarray(small / np.float32(255), np.float32)

        photo = int(self._views[view])
        picture, mattes = reduced(self._capture.images[photo]), self._capture.alphas
        if mattes is None:
            return picture, np.ones(picture.shape[:2], np.float32)
        return picture, np.asarray(cv2.erode(reduced(mattes[photo]), np.ones((EDGE, EDGE))),
                                   np.float32)

    def matter(self, points: Float64, hidden: float) -> Float64:
        """Share of the photos that see points [N, 3] whose mattes have matter there, float64 [N].

        A photo in which something lies more than ``hidden`` before a point, world units, does not
        see it: the face hides the gap below an ear's lobe from half of an arc. 1 where none does.
        """
        inside, seen = np.zeros((2, len(points)))
        for view in range(len(self._views)):
            shown, place, depth = self._shown(view, points)
            free = self._depths[view][place] > depth - hidden
            rows = np.flatnonzero(shown)[free]
            seen[rows] += 1
            inside[rows] += (self._matte(view)[place] > 127)[free]
        return np.where(seen > 0, inside / np.maximum(seen, 1), 1.0)

    def _matte(self, view: int) -> UInt8:
        """A photo's matte reduced to the camera's size, [H, W]."""
        assert self._capture.alphas is not None
        size = int(self.cameras.width[view]), int(self.cameras.height[view])
        return np.asarray(cv2.resize(self._capture.alphas[int(self._views[view])], size,
                                     interpolation=cv2.INTER_AREA), np.uint8)

    def person(self, view: int) -> tuple[Float64, Float64]:
        """Places [P, 3] that a view sees in its matte, and unit directions to them, [P, 3]."""
        inside = self._matte(view) > 127
        inside &= np.isfinite(self._depths[view])
        row, column = np.nonzero(inside)
        pixels = np.asarray(np.stack([column, row], axis=1) + 0.5, np.float64)
        origins, rays = self.cameras.rays(view, pixels)
        ahead = self.cameras.pose[view, :3, 2]
        return (origins + rays * (self._depths[view][inside] / (rays @ ahead))[:, None], rays)

    def depth_at(self, view: int, points: Float64) -> tuple[Float64, Float64, Bool]:
        """Depths of those of points [N, 3] that a view shows, and of what it sees there, [M].

        Also whether there is matter all around, [M]: next to holes and outlines there is not.
        """
        _, place, depth = self._shown(view, points)
        return (depth, np.asarray(self._depths[view][place], np.float64),
                np.isfinite(self._last[view][place]))

    def _even(self, first: Float32, last: Float32) -> Bool:
        """Where the depths of a pixel's neighbours, from first to last, are those of a surface."""
        near = np.isfinite(last)
        near[near] = last[near] - first[near] < STEEPEST * self.voxel
        return near

    def _shown(self, view: int, points: Float64) -> tuple[Bool, tuple[Int64, ...], Float64]:
        """Which points a view shows, their (row, column) and depths."""
        height, width = self._depths[view].shape
        pixels, depth = (part[0] for part in self.cameras[view].project(points))
        column, row = np.floor(pixels).astype(np.int64).T
        shown = (depth > 0) & (row >= 0) & (column >= 0) & (row < height) & (column < width)
        return shown, (row[shown], column[shown]), depth[shown]


def _facing(depth: Float64, focal: float) -> Float32:
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


def behind_what_is_seen(chart: Chart, distance: Float64, asked: Bool, photos: Photos,
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


_APART = 10.0  # Degrees between directions that count as two.
_SHARE = 0.2
"""Cosine between normal and direction below which a photo sees next to nothing of a place."""
_SMOOTH = 2.0  # Pixels over which normals are smoothed.
_PIXEL = 2.0
"""Width of the photos' pixels at the head, in voxels: what they show changes slowly over it."""
_TURNS = (-75.0, -45.0, -15.0, 15.0, 45.0, 75.0)
"""Degrees of the views over which the share is taken."""


class Coverage:
    """From how many directions the photos of a capture show the surface of a field.

    Parameters
    ----------
    field : Of a head, in the capture's frame.
    """

    ENOUGH = 3
    """Directions from which a place is seen well."""

    def __init__(self, field: VoxelField, capture: Capture) -> None:
        self.field = field
        self._chin = (-np.inf if capture.landmarks is None
                      else float(np.nan_to_num(capture.landmarks[8, 1], nan=-np.inf)))
        photos = Photos(field, capture, pixel=_PIXEL)
        x, y, z = photos.cameras.position.T
        turn, rise = np.degrees(np.arctan2(x, z)), np.degrees(np.arctan2(y, np.hypot(x, z)))
        cells = np.round(np.stack([turn, rise], axis=1) / _APART).astype(int)
        self._direction = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
        self._photos = photos

    def directions(self, cameras: Camera, view: int) -> Int32:
        """Directions that show what each pixel of a view shows, int32 [H, W]; -1: nothing."""
        return self._seen(cameras, view)[0]

    def _seen(self, cameras: Camera, view: int) -> tuple[Int32, Float64]:
        """The same, and the points that the pixels show, float64 [H, W, 3]."""
        alpha, depth = self.field.depth(cameras, view)
        points = np.asarray(surface_points(cameras, view, depth), np.float64)
        solid = (alpha > 0.5) & np.isfinite(points).all(axis=-1)
        normal = _normals(points, cameras.position[view])
        seen = np.zeros((self._direction.max() + 1, int(solid.sum())), bool)
        votes = self._photos.each(points[solid], normal[solid], _SHARE)
        for photo, sees in enumerate(votes):
            seen[self._direction[photo]] |= sees
        found = np.full(solid.shape, -1, np.int32)
        found[solid] = seen.sum(axis=0)
        return found, points

    def share(self, distance: float, size: int = 96) -> float:
        """Share of a head, 0 to 1, from profile to profile that photos show well (`ENOUGH`).

        Parameters
        ----------
        distance : Of the views' camera from the origin, world units.
        size : Their width and height in pixels.
        """
        views = Camera.arc(np.array(_TURNS), distance=distance, width=size, height=size,
                           focal=0.45 * size * distance)
        counted = [0, 0]
        for view in range(len(views)):
            found, points = self._seen(views, view)
            head = (found >= 0) & (points[..., 1] > self._chin)
            counted[0] += int((found[head] >= self.ENOUGH).sum())
            counted[1] += int(head.sum())
        return counted[0] / max(counted[1], 1)


def _normals(points: Float64, eye: Float64) -> Float64:
    """Normals [H, W, 3] of a picture of points, towards the eye."""
    down, across = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normal = np.nan_to_num(np.cross(down, across))
    # Lattice points leave steps where photos look along the surface.
    normal = ndimage.gaussian_filter(normal, (_SMOOTH, _SMOOTH, 0))
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    away = np.sign(((eye - points) * normal).sum(axis=-1, keepdims=True))
    return np.asarray(np.nan_to_num(normal * away), np.float64)
