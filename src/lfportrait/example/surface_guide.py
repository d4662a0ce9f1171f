"""Guides that are anchored to the surface of a head, for a capture seen from many sides.

A surface point gets the same exemplar coordinate in every view: it is unwrapped around the head,
and moving least squares takes the unwrapped plane to the exemplar. Below the brows the unwrapping
is a cylinder around the vertical axis, u = R atan2(x, z), v = y; above them it is a dome,
azimuthal and equidistant about the forward direction, so that the crown neither tears nor bunches
up. Both agree on the line between.

The exemplar shows a head from the front only. Angles beyond the cheeks are therefore squeezed
smoothly and monotonically into the band between face and outline, so that temples and ears find the
exemplar's, never its background. What lies further behind is put together from pieces
(`Patchwork`). The plane in which the chunks of the synthesis lie is the unsqueezed one: strokes
keep their size all around the head.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from ..arrays import Bool, Float32, Float64, Floats, Int32, Int64
from ..errors import UserError
from ..labels import PICTURE_LABELS
from .exemplar import Exemplar, face_size
from .guides.filters import broad_blur, grey
from .guides.position import fold_inside, mls_similarity
from .guides.regions import Regions
from .kernels.seeds import nearest_sites, seed_points

HAIR, NECK = 0, 1  # Materials of the pieces; -1 stands for a place that the exemplar shows.
CROWN = np.radians(75.0)
"""Angle from the forward direction from which the head above the brows is patchwork."""
BEHIND_EARS = np.radians(125.0)
"""And below the brows: the jaw's ends lie at 90 degrees, ears up to 115, a cell reaches 8."""
NAPE = np.radians(100.0)  # And below the ears.
SPREAD = 0.35
"""Pieces come from places up to this far from the guided one, over the exemplar's face size."""
SIDE = 0.3  # Side of a cell over the exemplar's face size.
ALIKE = 0.35
"""Share of the places that pieces of the neck come from: the plainest, most like the rest."""
SHOULDER = np.radians(50.0)
"""Angle from which what an exemplar without shoulders does not show is patchwork."""
EDGE = 0.35
"""Clothes are what lies further inside the person than this, over the exemplar's face size."""
SHORT = 1.4  # An exemplar that ends less deep than this (brows 0, chin 1) shows no shoulders.


@dataclass
class Sites:
    """Jittered sites of cells of the anchor plane."""

    points: Float32  # float32 [Y, X, 2], in exemplar pixels.
    chances: Float32  # float32 [Y, X, 2], two random numbers in [0, 1) of each.
    first: tuple[int, int]  # The first cell (column, row).

    @staticmethod
    def around(places: Float32, side: float) -> Sites:
        """The sites of all cells of ``side`` pixels that hold one of the places [N, 2]."""
        low, high = np.floor(places.min(axis=0) / side), np.floor(places.max(axis=0) / side)
        first = int(low[0]) - 1, int(low[1]) - 1
        shape = int(high[1]) - first[1] + 2, int(high[0]) - first[0] + 2, 2
        points, chances = np.empty(shape, np.float32), np.empty(shape, np.float32)
        seed_points(0, 0, *first, points)
        seed_points(1, 0, *first, chances)
        return Sites(points * np.float32(side), np.asarray(chances - np.floor(chances)), first)


class Patchwork:
    """Pieces of one exemplar for what it does not show."""

    def __init__(self, exemplar: Exemplar, regions: Regions) -> None:
        self.side, self.spread = SIDE * exemplar.size, SPREAD * exemplar.size
        luma = grey(exemplar.image)
        self._mean = broad_blur(luma, 0.6 * self.side)
        self._contrast = np.sqrt(np.maximum(
            broad_blur(luma * luma, 0.6 * self.side) - self._mean ** 2, 0))
        self.short = regions.lowest() < SHORT
        right, down = regions.frame.local(regions.person.shape)
        hair = (regions.hair if regions.hair is not None
                else regions.person * (down < -0.35).astype(np.float32))
        neck = regions.labels()[..., PICTURE_LABELS.index("body")] > 127
        if self.short:
            # Beside the chin such a mask may well hold background.
            neck &= np.abs(right) < 0.45
        found = (self._deep(hair > 0.5, 1.0), self._deep(neck, ALIKE))
        self.places = np.stack([place if place is not None else _everywhere(hair.shape)
                                for place in found])
        # Chunks of what lies near the edge spill over it.
        self.inside = distance_transform_edt(
            np.pad(regions.person > 0.5, 1, mode="edge"))[1:-1, 1:-1] > EDGE * exemplar.size
        self.known = np.array([place is not None for place in found])

    def _deep(self, region: Bool, share: float) -> Float32 | None:
        """For every pixel the nearest one deep inside a region, [h, w, 2] (x, y); None: no room.

        Only the ``share`` of plainest places count.
        """
        depth = distance_transform_edt(np.pad(region, 1))[1:-1, 1:-1]
        if depth.max() < 0.2 * self.side:
            return None
        deep = depth >= min(0.6 * self.side, 0.7 * float(depth.max()))
        # Plain pieces that are alike meet without a break.
        odd = self._contrast + np.abs(self._mean - np.median(self._mean[deep]))
        chosen = deep & (odd <= np.quantile(odd[deep], share))
        _, index = distance_transform_edt(~chosen, return_indices=True)
        return np.asarray(np.moveaxis(index, 0, -1)[..., ::-1] + 0.5, np.float32)

    def materials(self, angle: Float64, depth: Float64, bare: Bool) -> Int64:
        """Material of sites, [N].

        ``angle`` from forward, ``depth`` below the brows (1 = chin), and ``bare``, where the guide
        finds the exemplar's background or its edge, are [N].
        """
        out = np.full(angle.shape, -1)
        out[np.where(depth < 0, angle > CROWN, (angle > BEHIND_EARS) & (depth < 0.7))] = HAIR
        out[(depth >= 0.7) & (angle > np.where(depth < 1, NAPE, CROWN))] = NECK
        if self.short:
            out[(depth > 1.25) & (angle > SHOULDER)] = NECK
            # Clothes that it does show go on.
            out[(depth > 1.1) & ~bare] = -1
        return np.where((out >= 0) & self.known[out], out, -1)

    def pieces(self, wanted: Float32, chances: Float32, material: Int64) -> Float32:
        """Where in the exemplar the pieces of sites come from, [N, 2].

        ``wanted`` float32 [N, 2] is where the guide would look, ``chances`` [N, 2] are random
        numbers in [0, 1), ``material`` [N] is not negative.
        """
        near = wanted + np.float32(2 * self.spread) * (chances - np.float32(0.5))
        rows, columns = self.places.shape[1:3]
        x = np.clip(near[:, 0], 0, columns - 1).astype(np.int64)
        y = np.clip(near[:, 1], 0, rows - 1).astype(np.int64)
        return np.asarray(self.places[material, y, x], np.float32)

    def nearest(self, places: Float32, sites: Sites) -> Int32:
        """Flat number of the site nearest to each of the places [N, 2]."""
        out = np.empty(len(places), np.int32)
        nearest_sites(places, np.float32(self.side), sites.first, sites.points, out)
        return out


def _everywhere(shape: tuple[int, ...]) -> Float32:
    """Every pixel's own middle, [h, w, 2]."""
    return np.asarray(np.moveaxis(np.indices(shape[:2]), 0, -1)[..., ::-1] + 0.5, np.float32)


CHEEK = np.radians(60.0)  # Angles up to this one from the forward direction are not squeezed.
LIMIT = np.radians(92.0)  # Squeezed angles stay below this one.


def squeeze(angle: Floats) -> Float64:
    """Squeeze angles in [0, pi] beyond `CHEEK` below `LIMIT`, monotone with a continuous slope."""
    beyond = np.maximum(np.asarray(angle, np.float64) - CHEEK, 0.0)
    room = LIMIT - CHEEK
    return np.where(beyond > 0, CHEEK + room * (1 - np.exp(-beyond / room)), angle)


class HeadPlane:
    """The unwrapping of one head: of its landmarks alone, whatever the exemplar.

    Parameters
    ----------
    landmarks3d : float64 [68, 3] in the portrait frame (+y up, +z out of the face); NaN rows are
        unknown.

    Attributes
    ----------
    origin : float64 [3], on the head's vertical axis at the height of the brows.
    radius, height : Of the cylinder, and from the brows down to the chin, world units.
    """

    def __init__(self, landmarks3d: Floats) -> None:
        points = np.asarray(landmarks3d, np.float64)
        self.known = np.isfinite(points).all(axis=1)
        if self.known.sum() < 20:
            raise UserError(f"only {int(self.known.sum())} of 68 landmarks are known in space; add "
                            "frontal photos or a landmark file")
        self.landmarks = points
        self.origin = _head_origin(points)
        local = points[self.known] - self.origin
        self.radius = float(np.median(np.hypot(local[:, 0], local[:, 2])))
        self.height = float(np.nanmean(points[17:27, 1]) - np.nanmin(points[:, 1]))

    def unwrap(self, points: Floats, squeezed: bool = False) -> Float64:
        """Unwrapped coordinates [..., 2] of points [..., 3]: x right, y down, world units."""
        angle, side, y = self._angles(points)
        if squeezed:
            angle = squeeze(angle)
        reach = self.radius * angle
        return np.stack([reach * np.sin(side), np.where(y > 0, -reach * np.cos(side), -y)], axis=-1)

    def _angles(self, points: Floats) -> tuple[Float64, Float64, Float64]:
        """Angle from forward, direction (0 up, clockwise; +-90 degrees below the brows), height."""
        x, y, z = np.moveaxis(np.asarray(points, np.float64) - self.origin, -1, 0)
        # The axis leans back below the chin, or the chest would lie behind it.
        z = z + 1.5 * np.maximum(-y - 0.8 * self.height, 0.0)
        above = np.maximum(y, 0.0)
        across = np.hypot(x, above)
        return np.arctan2(across, z), np.arctan2(x, above), y


class SurfaceGuide:
    """The map from surface points of one head to one exemplar, whose regions may be known already.

    ``landmarks3d`` as in `HeadPlane`.
    """

    def __init__(self, landmarks3d: Floats, exemplar: Exemplar,
                 regions: Regions | None = None) -> None:
        self.plane = HeadPlane(landmarks3d)
        points, known = self.plane.landmarks, self.plane.known
        self.exemplar = exemplar
        self.regions = exemplar.regions() if regions is None else regions
        self.radius, self.height = self.plane.radius, self.plane.height
        flat = self.unwrap(points[known])
        style = exemplar.landmarks[known]
        self.scale = face_size(style) / face_size(flat)
        self.shift = style.mean(axis=0) - self.scale * flat.mean(axis=0)
        squeezed = self.unwrap(points, squeezed=True)
        extra, style_extra = self._border_points(squeezed)
        self.sources = np.concatenate([squeezed[known], extra])
        self.targets = np.concatenate([style, style_extra])
        self.softness = np.full(len(self.sources), 0.12 * self.radius)
        self.softness[:len(style)] = 0.0

    def unwrap(self, points: Floats, squeezed: bool = False) -> Float64:
        """Unwrapped coordinates; see `HeadPlane.unwrap`."""
        return self.plane.unwrap(points, squeezed)

    def _squeezed(self, flat: Float64) -> Float64:
        """Unwrapped coordinates [N, 2] with their angles squeezed."""
        x, y = flat[:, 0], flat[:, 1]
        reach = np.maximum(np.where(y < 0, np.hypot(x, y), np.abs(x)), 1e-9)
        share = self.radius * squeeze(reach / self.radius) / reach
        return np.stack([x * share, np.where(y < 0, y * share, y)], axis=-1)

    def _border_points(self, flat: Float64) -> tuple[Float64, Float64]:
        """Control points beyond the flat landmarks: head's outline, sides of the jaw, neck."""
        frame, regions = self.regions.frame, self.regions
        rays = np.radians(np.arange(-90, 91, 15.0))
        away = np.stack([np.sin(rays), -np.cos(rays)], axis=1)
        outline = regions.outline(rays) - frame.origin
        hairline = regions.hairline(rays) - frame.origin
        edge = np.linalg.norm(outline, axis=1)
        # A head seen from the front is taken for a ball: a fraction s of the way to the outline is
        # the angle asin(s). The ring in the middle is the hairline where it is known.
        middle = np.linalg.norm(hairline, axis=1) / edge
        middle = np.clip(np.where(np.isfinite(middle), middle, 0.7), 0.4, 0.85)
        # The back of the head lies in the middle of the hair: chunks copied there stay inside it.
        side_ring = 0.4 * middle + 0.6 * 0.95
        back_ring = side_ring + 0.03
        rings = ((middle, np.arcsin(middle)), (side_ring, np.pi / 2), (back_ring, np.pi))
        sources, targets = [], []
        for share, angle in rings:
            reach = self.radius * np.broadcast_to(squeeze(np.asarray(angle)), rays.shape)
            sources.append(reach[:, None] * away)
            targets.append(frame.origin + np.broadcast_to(share, rays.shape)[:, None] * outline)
        # Beside the brows the landmarks know better than the ball does.
        targets[0][np.abs(rays) > np.radians(50)] = np.nan
        style = self.exemplar.landmarks
        last = self.radius * float(squeeze(np.array(np.pi)))
        # Behind the jaw the exemplar has nothing: hold on to the jaw's own strip.
        jaw = np.array([1, 3, 5, 15, 13, 11])
        side = np.where(jaw < 8, -1.0, 1.0)
        ends = np.stack([side * last, flat[jaw, 1]], axis=1)
        ends[np.abs(flat[jaw, 0]) > 0.85 * last] = np.nan
        sources.append(ends)
        targets.append(style[jaw] + 0.03 * frame.height * side[:, None] * frame.right)
        # Neck and body: what the exemplar shows below the chin is spread over all that is below it.
        lowest = regions.lowest()
        for depth, below in ((min(1.15, lowest), 1.15), (lowest, max(1.9, lowest))):
            left, right = regions.edges(depth)
            middle_point = 0.5 * (left + right)
            level = self.height * below
            sources.append(np.array([[-last, level], [0.0, level], [last, level]]))
            targets.append(middle_point + 0.85 * np.stack(
                [left - middle_point, np.zeros(2), right - middle_point]))
        source, target = np.concatenate(sources), np.concatenate(targets)
        known = np.isfinite(target).all(axis=1) & np.isfinite(source).all(axis=1)
        return source[known], target[known]

    @functools.cached_property
    def patchwork(self) -> Patchwork:
        """Pieces for what lies behind the cheeks."""
        return Patchwork(self.exemplar, self.regions)

    def _pixels(self, position: Float32) -> tuple[Int64, Int64]:
        """Columns and rows of the exemplar's pixels at positions [N, 2], or next to them."""
        height, width = self.regions.person.shape
        return (np.clip(position[:, 0].astype(np.int64), 0, width - 1),
                np.clip(position[:, 1].astype(np.int64), 0, height - 1))

    def _onto_person(self, position: Float32) -> Float32:
        """Move positions [N, 2] that lie outside the exemplar's person to its nearest place."""
        x, y = self._pixels(position)
        near = self.regions.nearest[y, x]
        moved = np.abs(near - np.stack([x, y], axis=1) - np.float32(0.5)).max(axis=1) > 0.1
        return np.where(moved[:, None], near, position)

    def __call__(self, points: Floats) -> tuple[Float32, Float32]:
        """Guides of surface points [H, W, 3] in the portrait frame; NaN where there is no surface.

        Position float32 [H, W, 2], exemplar pixel coordinates, inside the exemplar; NaN without
        surface. Anchor float32 [H, W, 2], place in the unwrapped plane, in exemplar pixels.
        """
        points = np.asarray(points)
        inside = np.isfinite(points).all(axis=-1)
        seen = points[inside]
        position = np.full((*inside.shape, 2), np.nan, np.float32)
        anchor = np.full((*inside.shape, 2), np.nan, np.float32)
        flat = self.unwrap(seen)
        plane = np.asarray(self.scale * flat + self.shift, np.float32)
        if len(plane):
            position[inside] = self._onto_person(self._pieced(self._guided(flat), plane))
        anchor[inside] = plane
        return position, anchor

    def nodes(self, low: Float64, high: Float64, spacing: float) -> Float32:
        """The map on a regular grid of the unwrapped plane, without the pieces behind the cheeks.

        float32 [h, w, 3]: exemplar coordinates (x, y), and how much slower they change than the
        plane, at least 0.1 and at most 1. ``low`` and ``high`` [2] are corners of the plane's part,
        from the first of which nodes lie ``spacing`` apart; world units.
        """
        columns, rows = (int(n) for n in np.ceil((high - low) / spacing).astype(int) + 2)
        x, y = np.meshgrid(low[0] + spacing * np.arange(columns),
                           low[1] + spacing * np.arange(rows))
        flat = np.stack([x.ravel(), y.ravel()], axis=-1)
        position = self._onto_person(self._guided(flat)).reshape(rows, columns, 2)
        steps = [np.linalg.norm(np.gradient(position, axis=axis), axis=-1) for axis in (0, 1)]
        ratio = np.clip(np.minimum(*steps) / (self.scale * spacing), 0.1, 1.0)
        return np.concatenate([position, ratio[..., None]], axis=-1).astype(np.float32)

    def _guided(self, flat: Float64) -> Float32:
        """Exemplar coordinates [N, 2] of unwrapped ones."""
        mapped = mls_similarity(self._squeezed(flat), self.sources, self.targets,
                                softness=self.softness)
        return fold_inside(mapped.astype(np.float32), self.exemplar.image.shape, self.regions.box())

    def _pieced(self, position: Float32, plane: Float32) -> Float32:
        """Positions [N, 2] of places in the plane, those behind the cheeks by `Patchwork`."""
        sites = Sites.around(plane, self.patchwork.side)
        points = sites.points.reshape(-1, 2)
        flat = (points.astype(np.float64) - self.shift) / self.scale
        above = flat[:, 1] < 0
        angle = np.where(above, np.hypot(flat[:, 0], flat[:, 1]), np.abs(flat[:, 0])) / self.radius
        guided = self._guided(flat)
        column, row = self._pixels(guided)
        material = self.patchwork.materials(angle, flat[:, 1] / self.height,
                                            ~self.patchwork.inside[row, column])
        behind = np.flatnonzero(material >= 0)
        moves = np.full(points.shape, np.nan, np.float32)
        moves[behind] = self.patchwork.pieces(
            guided[behind], sites.chances.reshape(-1, 2)[behind],
            material[behind]) - points[behind]
        moved = plane + moves[self.patchwork.nearest(plane, sites)]
        return np.where(np.isfinite(moved), moved, position)


def _head_origin(landmarks: Float64) -> Float64:
    """Point on the head's vertical axis at the height of the brows, [3]."""
    jaw_ends = landmarks[[0, 16]]
    x = float(np.nanmean([np.nanmean(landmarks[[i, j], 0]) for i, j in
                          ((36, 45), (39, 42), (31, 35), (48, 54)) if np.isfinite(
                              landmarks[[i, j], 0]).all()] or [np.nanmean(landmarks[:, 0])]))
    y = float(np.nanmean(landmarks[17:27, 1]))
    # The ends of the jaw lie at the ears, which are in the middle of the head's depth.
    z = float(np.nanmean(jaw_ends[:, 2])) if np.isfinite(jaw_ends[:, 2]).any() else 0.0
    return np.array([x, y, z])
