"""Clean plates: what is behind the person in each photo, composed from the others.

With known cameras the room moves otherwise than the person before it. Some photos (the anchors),
spread over all, get their depth by a plane sweep. What lies well behind the person, whatever a
network says of it, gives the surface of the room, continued where nothing is known of it; of a
plain wall nothing is known, and nothing needs to be but that it is far. A photo's clean plate shows
that surface with the colors of the anchors in which the person does not hide it. Against it the
person stands out as before a known background: a pixel that differs from its plate by more than the
plate's noise, in a color that the person has nearby, is the person's. Where the plate is plain, or
not known, a color alone does not outweigh a network that is sure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import Bool, Float32, Float64, Floats, Int64, UInt8
from ...capture import Camera, Capture, color_likelihood, refine_matte
from ...progress import Progress, note
from ...simd.threads import side_by_side
from ..kernels.depth_maps import compose_plate
from .sweep import DepthMap, continued, small_view, sweep_depth

Plane = Float32

_ANCHORS, _PLANES = 16, 48
_SIDE = 480  # height or width of a plate
_REACH = 1.2  # distance from the origin to which the person may reach towards the cameras
WIDEST = 100.0  # degrees between two cameras from which on the anchors are too far apart
_CLOSE = 0.75  # part of the person's inverse depth above which a wall moves like the person
_PLAIN = 0.3  # part of the person's inverse depth at which a wall without texture is put
_TEXTURED = 0.03  # part of the room with depth that is needed to believe it
_FEWEST = 200  # points of the room, fewer of which say nothing
_BEHIND, _BEFORE = 0.35, 0.6  # parts of the way from the room to the person, in inverse depth
_HUNCH = 0.02  # weight of what the network takes for the person and depth says nothing of
_LEAST = 0.03  # weight of surroundings from which what is not known is continued
_ENOUGH = 4.0  # weights of anchors that make a plate
_KNOWN = 0.3  # and that are needed
_SPREAD = 0.08  # difference of colors that is no noise
_SENSOR = 0.02  # standard deviation of a photo's colors, of 1
_SLIP = 0.7  # pixels by which a plate may be displaced
_SURE, _COLOR = 0.95, 2.5  # a network's sure word, and what a color alone says against it
_CERTAIN = 10.0  # bound of what colors say, as log-odds


@dataclass(frozen=True)
class Plate:
    """What is behind the person in a reduced photo."""

    color: Float32  # float32 [h, w, 3], sRGB in [0, 1].
    # float32 [h, w, 3], of the colors: noise, displacement, or how they vary around where they are
    # not known.
    variance: Float32
    known: Bool  # bool [h, w], where anchors show them.
    texture: Plane  # float32 [h, w], standard deviation of the colors around.

    @property
    def textured(self) -> Bool:
        """Where anchors show more than one color around, bool [H, W]: no chance does that."""
        least = np.minimum.reduce([self.variance[..., k] for k in range(3)])
        return self.known & (self.texture > 2.0 * np.sqrt(least))


def plate_mattes(capture: Capture, mattes: Sequence[Floats],
                 progress: Progress | None = None) -> list[Plane] | None:
    """Mattes of the person against what is behind, along the photos' edges.

    float32 [H, W] in [0, 1], of a network's, most of them right. None where there is no telling
    person and room apart (`CleanPlates.of`).
    """
    note(progress, "cutting out the person: the room behind")
    plates = CleanPlates.of(capture, mattes)
    if plates is None:
        return None

    def cut(view: int) -> Plane:
        image = capture.images[view]
        height, width = image.shape[:2]
        person = cv2.resize(plates.person(view), (width, height), interpolation=cv2.INTER_LINEAR)
        return refine_matte(image, np.asarray(person), max(2, round(max(height, width) / _SIDE)))

    return side_by_side(cut, range(len(capture)), 2)


class CleanPlates:
    """Clean plates of a capture's photos; made by `of`."""

    def __init__(self, capture: Capture, mattes: Sequence[Floats],
                 views: Int64, maps: list[DepthMap], near: float, far: float) -> None:
        self.capture, self.mattes, self.views, self.near = capture, mattes, views, near
        # Depth beside the person is often the person's: windows of the sweep reach across the edge.
        far = min(far, 0.7 * near)
        small = [_reduced(mattes[view], one.depth.shape) for view, one in zip(views, maps)]
        seeds = [_away(matte) & (1.0 / one.depth < 0.5 * (near + far))
                 for matte, one in zip(small, maps)]
        self._points = np.concatenate([_chosen(one, seed) for one, seed in zip(maps, seeds)])
        behind = [self._part(one) < _BEHIND for one in maps]
        self._points = np.concatenate([_chosen(one, back | seed)
                                       for one, back, seed in zip(maps, behind, seeds)])
        self._anchors(maps, small)

    @classmethod
    def of(cls, capture: Capture, mattes: Sequence[Floats]) -> CleanPlates | None:
        """The plates of photos with a network's mattes, [H, W] in [0, 1].

        None where the cameras stand all around, the person's depth is not found, or the wall is
        so close that it moves like the person.
        """
        views = capture.training()
        if len(views) < 6 or _span(capture.cameras[views]) > WIDEST:
            return None
        views = views[np.linspace(0, len(views) - 1, min(_ANCHORS, len(views))).astype(int)]
        maps = sweep_depth(capture, views, _REACH, endless=True, planes=_PLANES)
        small = [_reduced(mattes[view], one.depth.shape) for view, one in zip(views, maps)]
        person, room = (np.concatenate([1.0 / one.depth[mask] for one, mask in zip(maps, masks)])
                        for masks in ([matte > 0.9 for matte in small],
                                      [_away(matte) for matte in small]))
        if np.isfinite(person).sum() < _FEWEST:
            return None
        near = float(np.nanmedian(person))
        # A wall without texture has depth here and there, and wrong.
        plain = np.isfinite(room).mean() < _TEXTURED if len(room) else True
        far = _PLAIN * near if plain else float(np.nanmedian(room))
        return cls(capture, mattes, views, maps, near, far) if far < _CLOSE * near else None

    def _surface(self, camera: Camera) -> Plane:
        """Inverse depth of the room in a small camera's picture, float32 [h, w]."""
        height, width = int(camera.height[0]), int(camera.width[0])
        if len(self._points) < _FEWEST:
            return np.full((height, width), _PLAIN * self.near, np.float32)
        seen, place, along = _seen(self._points, camera)
        mass = np.bincount(place, minlength=height * width)
        total = np.bincount(place, 1.0 / along[seen], height * width)
        both = np.dstack([mass.reshape(height, width), total.reshape(height, width)])
        inverse = continued(both.astype(np.float32), 1.0, _LEAST)[..., 0]
        return np.asarray(cv2.medianBlur(inverse, 5))

    def _part(self, one: DepthMap) -> Plane:
        """How far from the room to the person what a depth map shows is; NaN where not known."""
        room = self._surface(one.camera)
        part = (1.0 / one.depth - room) / np.maximum(self.near - room, 1e-3)
        return np.asarray(part, np.float32)

    def _anchors(self, maps: list[DepthMap], small: list[Plane]) -> None:
        """The anchors' pictures with weights, and colors of the room to compare exposures by."""
        rows, pictures, points, colors = [], [], [], []
        for view, one, matte in zip(self.views, maps, small):
            weight = _weights(matte, self._part(one))
            camera, image = self._plate_size(int(view))
            rows.append(camera.row(0))
            large = cv2.resize(weight, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
            pictures.append(np.dstack([image, np.asarray(255.0 * large + 0.5, np.uint8)]))
            surface = DepthMap(one.camera, one.image, np.asarray(1.0 / self._surface(one.camera)))
            points.append(_chosen(surface, weight > 0.2))
            colors.append(one.image[_sparse(weight > 0.2)])
        self._rows, self._pictures = np.array(rows), np.array(pictures)
        self._samples, self._colors = np.concatenate(points), np.concatenate(colors)
        self._owner = np.repeat(np.arange(len(points)), [len(part) for part in points])

    def _plate_size(self, view: int) -> tuple[Camera, UInt8]:
        image = self.capture.images[view][..., :3]
        camera = self.capture.cameras[view].scaled(min(1.0, _SIDE / max(image.shape[:2])))
        size = int(camera.width[0]), int(camera.height[0])
        return camera, np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))

    def _gains(self, one: DepthMap, matte: Plane) -> Float32:
        """A photo's exposure over each anchor's, float32 [K, 3], by what both show of the room."""
        seen, place, _ = _seen(self._samples, one.camera)
        free = matte.ravel()[place] < 0.1
        place, owner = place[free], self._owner[seen][free]
        ratio = np.log((one.image.reshape(-1, 3)[place] + 0.03) / (self._colors[seen][free] + 0.03))
        gains = np.ones((len(self.views), 3), np.float32)
        for anchor in range(len(self.views)):
            own = owner == anchor
            if own.sum() > 50:
                gains[anchor] = np.exp(np.median(ratio[own], axis=0))
        return gains

    def plate(self, view: int) -> tuple[Float32, Plane, Plate]:
        """A reduced photo, the network's matte of it, and its plate.

        float32 [h, w, 3] in [0, 1] and float32 [h, w]. The photo itself tells nothing of its plate.
        """
        one = small_view(self.capture, view)
        camera, image = self._plate_size(view)
        shape = image.shape[:2]
        matte = _reduced(self.mattes[view], shape)
        away = np.linalg.norm(self.capture.cameras.position[self.views]
                              - camera.position[0], axis=1)
        others = np.argsort(away)
        room = cv2.resize(self._surface(one.camera), shape[::-1], interpolation=cv2.INTER_LINEAR)
        gains = self._gains(one, _reduced(self.mattes[view], one.depth.shape))
        color, noise, known = compose_plate(
            np.asarray(room), _near(matte), camera.row(0), self._rows, self._pictures,
            others[self.views[others] != view], gains, np.float32(_ENOUGH), np.float32(_SPREAD))
        return image.astype(np.float32) / 255.0, matte, _completed(color, noise, known)

    def person(self, view: int) -> Plane:
        """How much of each pixel of a reduced photo is the person, float32 [h, w] in [0, 1]."""
        image, matte, plate = self.plate(view)
        squared = (image - plate.color) ** 2 / plate.variance
        room = np.float32(-0.5) * _total(squared + np.log(plate.variance))
        # Where no anchor shows it, the room is also what the photo itself has beside the person.
        beside, some = color_likelihood(image, (matte < 0.2).astype(np.float32), 4)
        room = np.where(plate.known | (some < 0.01), room, np.maximum(room, beside))
        textured = plate.textured
        shown = textured & (cv2.blur(_total(squared), (5, 5)) < 9.0)
        own, near = color_likelihood(image, ((matte > 0.8) & ~shown).astype(np.float32), 4)
        # A color that neither has is a new one of the person's: nobody else came in.
        odds = np.clip(np.maximum(own, -8.0) - np.maximum(room, -14.0), -_CERTAIN, _CERTAIN)
        odds = cv2.GaussianBlur(np.where(near > 0.01, odds, 0.0).astype(np.float32), (0, 0), 0.6)
        # White linen before a white wall: of what the network is sure, a color alone says little.
        free = textured | (matte < _SURE)
        odds = np.where(free, odds, np.maximum(odds, -_COLOR))
        word = np.clip(matte, 0.02, 0.98)
        sure = np.asarray(1.0 / (1.0 + np.exp(-(odds + np.log(word / (1.0 - word))))), np.float32)
        sure = np.where(_near(matte) > 0, sure, np.float32(0.0))
        return _one_piece(np.asarray(cv2.medianBlur(sure, 5)))


def _total(channels: Float32) -> Plane:
    """Sum of three channels [h, w, 3], [h, w]: along an axis of three NumPy is ten times slower."""
    return channels[..., 0] + channels[..., 1] + channels[..., 2]


def _span(cameras: Camera) -> float:
    """The widest angle in degrees between two of the cameras, as seen from the origin."""
    away = cameras.position / np.linalg.norm(cameras.position, axis=1, keepdims=True)
    return float(np.degrees(np.arccos(np.clip((away @ away.T).min(), -1.0, 1.0))))


def _reduced(matte: Floats, shape: tuple[int, ...]) -> Plane:
    return np.asarray(cv2.resize(np.asarray(matte, np.float32), (shape[1], shape[0]),
                                 interpolation=cv2.INTER_AREA))


def _away(matte: Plane) -> Bool:
    """What lies well beside the person in a small matte."""
    return np.asarray(cv2.dilate((matte > 0.05).astype(np.uint8), np.ones((11, 11), np.uint8)) == 0)


def _near(matte: Plane) -> UInt8:
    """What may be the person: where the network's matte says so, and around that."""
    side = max(matte.shape) // 8 | 1
    return np.asarray(cv2.dilate((matte > 0.05).astype(np.uint8), np.ones((side, side), np.uint8)))


def _sparse(mask: Bool) -> Bool:
    """Every third pixel of a mask along both axes."""
    kept = np.zeros_like(mask)
    kept[::3, ::3] = mask[::3, ::3]
    return kept


def _chosen(one: DepthMap, mask: Bool) -> Float64:
    """Some of a depth map's points in a mask, float64 [N, 3]."""
    depth = np.where(_sparse(mask), one.depth, np.float32(np.nan))
    return DepthMap(one.camera, one.image, depth).points()


def _seen(points: Float64, camera: Camera) -> tuple[Bool, Int64, Float64]:
    """Which points a camera has in its picture, their pixels in scan order, all points' depth."""
    pixels, along = camera.project(points)
    column, row = np.floor(pixels[0]).astype(np.int64).T
    width, height = int(camera.width[0]), int(camera.height[0])
    seen = (along[0] > 0) & (column >= 0) & (row >= 0) & (column < width) & (row < height)
    return seen, row[seen] * width + column[seen], along[0]


def _weights(matte: Plane, part: Plane) -> Plane:
    """How surely an anchor's pixels show the room; by depth, and by the network where none is."""
    behind, before = part < _BEHIND, part > _BEFORE
    weight = np.where(behind, 1.0, 0.3 * np.clip(1.0 - 1.25 * matte, 0.0, 1.0) ** 2)
    person = (((matte > 0.5) & ~behind) | before).astype(np.uint8)
    person = np.asarray(cv2.dilate(cv2.medianBlur(person, 3), np.ones((3, 3), np.uint8)))
    # The network may be wrong of the same piece of wall in all photos: its texture will show it.
    weight = np.maximum(np.where(person > 0, 0.0, weight), _HUNCH)
    return np.where(before, 0.0, weight).astype(np.float32)


def _completed(color: Float32, noise: Plane, known: Plane) -> Plate:
    """A plate from composed colors: with the room's colors around where no anchor shows it."""
    side = (9, 9)
    texture = cv2.blur(color**2, side) - cv2.blur(color, side) ** 2
    texture = np.sqrt(_total(np.maximum(texture, 0.0)) / np.float32(3.0))
    # What moves as the room does is the room, where it has a texture that would show otherwise.
    moves = (known > 2.5 * _HUNCH) & (texture > 2.0 * cv2.blur(noise, side) + 0.02)
    moves = cv2.morphologyEx(moves.astype(np.uint8), cv2.MORPH_OPEN, np.ones((7, 7), np.uint8))
    sure = (known > _KNOWN) | (moves > 0)
    slopes = sum(cv2.Sobel(color, cv2.CV_32F, *axis, ksize=3, scale=1 / 8) ** 2
                 for axis in ((1, 0), (0, 1)))
    variance = _SENSOR**2 + noise[..., None] ** 2 + _SLIP**2 * slopes
    size = [max(1, -(-length // 8)) for length in reversed(sure.shape)]
    weighted = color * sure[..., None]
    sums = np.dstack([cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in (
        sure.astype(np.float32), weighted, weighted * color)])
    around = continued(np.asarray(sums, np.float32), 4.0, _LEAST)
    mean, square = (np.asarray(cv2.resize(part, sure.shape[::-1], interpolation=cv2.INTER_LINEAR))
                    for part in (around[..., :3], around[..., 3:]))
    spread = np.maximum(square - mean**2, 0.0) + 0.03**2
    # Without any known color there is nothing to compare with.
    spread = spread if sure.any() else np.ones_like(spread)
    seen = sure[..., None]
    return Plate(np.where(seen, color, mean).astype(np.float32),
                 np.where(seen, variance, spread).astype(np.float32), sure,
                 np.asarray(texture, np.float32))


def _one_piece(person: Plane) -> Plane:
    """A matte without pieces much smaller than the largest, and without its smallest holes."""
    mask = (person > 0.5).astype(np.uint8)
    for inside, least in ((mask, 0), (1 - mask, 60)):
        count, labels, sizes, _ = cv2.connectedComponentsWithStats(inside, connectivity=4)
        if count < 2:
            continue
        areas = sizes[1:, cv2.CC_STAT_AREA]
        drop = areas < (least or 0.1 * areas.max())
        person = np.where(np.append(False, drop)[labels], np.float32(least > 0), person)
    return person.astype(np.float32)
