"""Places of a head that two photos show: how a turned face lies is seen by more than landmarks.

Detectors see a face that is turned by 45 degrees as turned by 40, and its landmarks lie elsewhere
than those of a frontal face. What the skin itself shows does not: the other photo is laid over the
first one by the head that was fitted so far, and what is left between the two is found by dense
optical flow (DIS; Kroeger et al. 2016). Photos of different days are known by it: little of what
they show is alike.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...arrays import Bool, Float32, Float64
from ..head_fit import Found, HeadFit, Picture
from ..head_prior import EYES, SOCKETS, with_normals

Bytes = NDArray[np.uint8]

EYES_WIDE = 130.0
"""Pixels that the outer corners of the eyes are apart where photos are compared, at most."""
SQUARE = 0.3  # Cosine of incidence from which on a photo shows a vertex well enough.
BEHIND = 0.006  # Metres that a vertex may lie behind what is nearest to the camera.
WINDOW, LIKE, TEXTURE = 15, 0.75, 0.02
"""Side of windows that are compared (pixels); correlation from which on they show the same; and
deviation of their grey values from which on they show anything."""
FURTHEST = 0.15  # A place is looked for so far away at most, over the distance of the eyes.
VERY_LIKE, SAME, LEAST = 0.9, 0.27, 200
"""Correlation from which on windows are very like; from which share of such windows on two photos
are of one moment (of one they have 0.40 to 0.95, of different days or expressions 0 to 0.18); and
pixels that say it at least."""
MOST = 160  # Places that are taken of a photo, at most.


def of_one_moment(fit: HeadFit, pictures: list[Picture], images: list[Bytes]) -> list[bool]:
    """Which photos show the face as the first one does, or as another of these does.

    The others may be of another day or expression, much less sharp, or show too little of the same.
    How bright a photo is does not matter.

    Parameters
    ----------
    pictures, images : The fit's photos; uint8 [H, W, 3].

    Returns
    -------
    same : For each photo; True for the first.
    """
    out, seen = [True], [_seen(fit, pictures, view) for view in range(len(pictures))]
    for other in range(1, len(pictures)):
        # It is compared with the one of that moment that shows most of the same.
        one = max((one for one in range(other) if out[one]),
                  key=lambda one: (seen[one] & seen[other]).sum())
        laid = _Laid.of(fit, pictures, images, one, other)
        share = None if laid is None else laid.alike()
        out.append(share is not None and share > SAME)
    return out


def found_again(fit: HeadFit, pictures: list[Picture], images: list[Bytes]) -> list[list[Found]]:
    """Where each photo shows vertices that the first one shows, too.

    Parameters
    ----------
    pictures, images : Its photos; uint8 [H, W, 3].

    Returns
    -------
    found : A list for each photo. What the first one shows lies there where the head has it now.
    """
    out: list[list[Found]] = [[] for _ in pictures]
    for other in range(1, len(pictures)):
        laid = _Laid.of(fit, pictures, images, 0, other)
        match = None if laid is None else laid.matches()
        if match is not None:
            vertices, there, here = match
            out[0].append(Found(vertices, there))
            out[other].append(Found(vertices, here))
    return out


class _Laid(NamedTuple):
    """A photo that is laid over another one, in the pixels of the latter around the face.

    The vertices [M] that both show, and their places [M, 2] in those pixels; how far what they show
    lies elsewhere [h, w, 2]; how like it is there [h, w], 0 where it is plain; where that is known;
    and what gives places in both photos.
    """

    vertices: NDArray[np.int64]
    places: Float64
    flow: Float32
    like: Float32
    inner: Bool
    corner: NDArray[np.int_]
    lies: Callable[[Float64], Float64]
    scales: tuple[float, float]

    @staticmethod
    def of(fit: HeadFit, pictures: list[Picture], images: list[Bytes], first: int, other: int,
           ) -> _Laid | None:
        """Photo ``other`` over ``first``, None if both show too little of the same."""
        from scipy.interpolate import LinearNDInterpolator

        seen = _seen(fit, pictures, first) & _seen(fit, pictures, other)
        if seen.sum() < 100:
            return None
        scales = min(1.0, EYES_WIDE / _eyes(fit, first)), min(1.0, EYES_WIDE / _eyes(fit, other))
        pair = list(zip((first, other), scales, strict=True))
        one, two = (fit.views[index].project(fit.vertices(index)) * scale for index, scale in pair)
        grey = [_grey(images[index], scale) for index, scale in pair]
        low = np.floor(one[seen].min(axis=0)).astype(int) - 4
        size = np.ceil(one[seen].max(axis=0)).astype(int) + 5 - low
        columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
        lies = LinearNDInterpolator(one[seen] - low - 0.5, two[seen] - 0.5)
        place = lies(np.stack([columns, rows], axis=-1).reshape(-1, 2)).reshape(*size[::-1], 2)
        mask = _covered(fit, seen, one - low - 0.5, size) & np.isfinite(place).all(axis=-1)
        place = np.nan_to_num(place, nan=-9.0).astype(np.float32)
        shown = _at(grey[0], np.stack([columns + low[0], rows + low[1]], axis=-1))
        flow, like = _flow(shown, _at(grey[1], place), mask)
        inner = cv2.erode(mask.astype(np.uint8), np.ones((7, 7))) > 0
        return _Laid(np.flatnonzero(seen), one[seen] - low - 0.5, flow, like, inner, low, lies,
                     scales)

    def alike(self) -> float | None:
        """Share of what is not plain that is very like; None if there is too little of it."""
        known = self.like[self.inner & (self.like != 0)]
        return float((known > VERY_LIKE).mean()) if len(known) >= LEAST else None

    def matches(self) -> tuple[NDArray[np.int64], Float64, Float64] | None:
        """Vertices [M] and their places [M, 2] in either photo, in its own pixels."""
        size = np.array(self.like.shape[::-1])
        column, row = np.clip(np.rint(self.places).astype(int), 0, size - 1).T
        move = self.flow[row, column]
        good = (self.inner & (self.like > LIKE))[row, column]
        good &= np.linalg.norm(move, axis=1) < FURTHEST * EYES_WIDE
        vertices, places = self.vertices[good], self.places[good]
        found = self.lies(places + move[good]) + 0.5
        known = np.isfinite(found).all(axis=1)
        vertices, places, found = vertices[known], places[known], found[known]
        if len(vertices) < 12:
            return None
        chosen = _spread(places, MOST)
        here = places[chosen] + self.corner + 0.5
        return vertices[chosen], here / self.scales[0], found[chosen] / self.scales[1]


def _eyes(fit: HeadFit, index: int) -> float:
    """Pixels that the eyes' outer corners would be apart in a photo if it looked squarely."""
    corners = fit.vertices(index)[fit.prior.landmarks[[36, 45]]]
    view = fit.views[index]
    return float(np.linalg.norm(corners[1] - corners[0]) * view.focal / view.shift[2])


def _seen(fit: HeadFit, pictures: list[Picture], index: int) -> Bool:
    """The vertices [N] of skin that a photo shows."""
    view, prior, picture = fit.views[index], fit.prior, pictures[index]
    vertices = fit.vertices(index)
    local = view.to_camera(vertices)
    turned = with_normals(vertices, prior.triangles) @ view.rotation.T
    cosine = -(turned * local).sum(axis=1) / np.linalg.norm(local, axis=1)
    out = (cosine > SQUARE) & ~np.isin(prior.part, (SOCKETS, EYES))
    pixels = view.project(vertices)
    width, height = picture.size
    out &= ((pixels > 2) & (pixels < np.array([width - 2, height - 2]))).all(axis=1)
    column, row = np.clip(pixels.astype(int), 0, [[width - 1, height - 1]]).T
    for mask, limit in ((picture.inside, 2.0), (picture.hair, None)):
        if mask is not None:
            out &= mask[row, column] > limit if limit is not None else mask[row, column] < 0.5
    # Nothing lies before it: the nearest of all vertices, in cells some millimetres wide.
    cell = 0.004 * view.focal / view.shift[2]
    bin_ = np.floor((pixels - pixels.min(axis=0)) / cell).astype(int)
    shape = bin_.max(axis=0) + 1
    nearest = np.full(int(shape.prod()), np.inf)
    flat = np.ravel_multi_index(tuple(bin_.T), tuple(shape))
    front = cosine > 0
    np.minimum.at(nearest, flat[front], local[front, 2])
    around = cv2.erode(nearest.reshape(tuple(shape)), np.ones((3, 3))).ravel()
    slope = 2 * 0.004 * np.sqrt(np.maximum(1 / np.maximum(cosine, SQUARE) ** 2 - 1, 0))
    return np.asarray(out & (local[:, 2] < around[flat] + BEHIND + slope))


def _grey(image: Bytes, scale: float) -> Float32:
    """A photo [h, w] in [0, 1], smaller, its light evened over the width of half a face."""
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), np.float32) / np.float32(255)


def _at(grey: Float32, places: NDArray[np.floating[Any]]) -> Float32:
    """A photo [H, W] at pixels (x, y) [h, w, 2], [h, w]."""
    x, y = (np.ascontiguousarray(places[..., axis], np.float32) for axis in (0, 1))
    return np.asarray(cv2.remap(grey, x, y, cv2.INTER_LINEAR), np.float32)


def _covered(fit: HeadFit, seen: Bool, places: Float64, size: NDArray[np.int_]) -> Bool:
    """Pixels [h, w] of the triangles whose corners are all seen."""
    triangles = fit.prior.triangles[seen[fit.prior.triangles].all(axis=1)]
    mask = np.zeros(tuple(size[::-1]), np.uint8)
    for corners in np.rint(places[triangles]).astype(np.int32):
        cv2.fillConvexPoly(mask, corners, 1)
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3))) > 0)


def _flow(one: Float32, two: Float32, mask: Bool) -> tuple[Float32, Float32]:
    """How far what ``one`` shows lies elsewhere in ``two``, [h, w, 2], and how like it is."""
    even = [_evened(each, mask) for each in (one, two)]
    finder = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    finder.setUseSpatialPropagation(True)
    first, second = (np.asarray(np.clip(127 + 40 * each, 0, 255), np.uint8) for each in even)
    flow = np.asarray(finder.calc(first, second, np.zeros((*one.shape, 2), np.float32)), np.float32)
    rows, columns = np.mgrid[:one.shape[0], :one.shape[1]].astype(np.float32)
    back = np.asarray(cv2.remap(two, columns + flow[..., 0], rows + flow[..., 1],
                                cv2.INTER_LINEAR), np.float32)
    weight = _blurred(mask.astype(np.float32))
    means = [_blurred(each * mask) / np.maximum(weight, 1e-6) for each in (one, back)]
    parts = [each - mean for each, mean in zip((one, back), means, strict=True)]
    squares = [_blurred(part * part * mask) for part in parts]
    both = _blurred(parts[0] * parts[1] * mask)
    like = both / np.sqrt(np.maximum(squares[0] * squares[1], 1e-12))
    plain = squares[0] / np.maximum(weight, 1e-6) < TEXTURE ** 2
    return flow, np.where(plain, np.float32(0), like).astype(np.float32)


def _blurred(values: NDArray[np.floating[Any]]) -> Float32:
    return np.asarray(cv2.GaussianBlur(values, (WINDOW, WINDOW), 0), np.float32)


def _evened(grey: Float32, mask: Bool) -> Float32:
    """Grey values less their surroundings', over how much these differ; 0 outside of the mask."""
    sigma = 0.15 * EYES_WIDE
    weight = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), sigma) + np.float32(1e-4)
    mean = cv2.GaussianBlur(grey * mask, (0, 0), sigma) / weight
    part = (grey - mean) * mask
    spread = np.sqrt(np.maximum(cv2.GaussianBlur(part * part, (0, 0), 2 * sigma), 0)
                     / cv2.GaussianBlur(mask.astype(np.float32) + np.float32(1e-4), (0, 0),
                                        2 * sigma))
    return np.asarray(part / np.maximum(spread, 0.01), np.float32)


def _spread(points: Float64, most: int) -> NDArray[np.int64]:
    """Indices of about ``most`` of points [N, 2], evenly spread."""
    area = float(np.ptp(points, axis=0).prod())
    cells = np.floor(points / max(np.sqrt(area / most), 1e-9)).astype(np.int64)
    return np.asarray(np.unique(cells, axis=0, return_index=True)[1], np.int64)
