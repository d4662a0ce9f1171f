"""Places of a head that two photos show: how a turned face lies is seen by more than landmarks.

Detectors see a face that is turned by 45 degrees as turned by 40, and its landmarks lie elsewhere
than those of a frontal face. What the skin itself shows does not: the other photo is laid over the
first one by the head that was fitted so far, and what is left between the two is found by dense
optical flow (DIS; Kroeger et al. 2016).
"""

from __future__ import annotations

from typing import Any

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
MOST = 160  # Places that are taken of a photo, at most.


def found_again(fit: HeadFit, pictures: list[Picture], images: list[Bytes]) -> list[list[Found]]:
    """Where each photo shows vertices that another shows, too.

    Parameters
    ----------
    pictures, images : Its photos; uint8 [H, W, 3].

    Returns
    -------
    found : A list for each photo. What the first one shows lies there where the head has it now.
    """
    out: list[list[Found]] = [[] for _ in pictures]
    for other in range(1, len(pictures)):
        match = _matched(fit, pictures, images, other)
        if match is not None:
            vertices, there, here = match
            out[0].append(Found(vertices, there))
            out[other].append(Found(vertices, here))
    return out


def _matched(fit: HeadFit, pictures: list[Picture], images: list[Bytes], other: int,
             ) -> tuple[NDArray[np.int64], Float64, Float64] | None:
    """Vertices [M] and their places [M, 2] in the first photo and in another one."""
    from scipy.interpolate import LinearNDInterpolator

    seen = _seen(fit, pictures, 0) & _seen(fit, pictures, other)
    if seen.sum() < 100:
        return None
    scales = [min(1.0, EYES_WIDE / _eyes(fit, one)) for one in (0, other)]
    one, two = (fit.views[index].project(fit.vertices(index)) * scale
                for index, scale in zip((0, other), scales, strict=True))
    grey = [_grey(images[index], scale) for index, scale in zip((0, other), scales, strict=True)]
    low = np.floor(one[seen].min(axis=0)).astype(int) - 4
    size = np.ceil(one[seen].max(axis=0)).astype(int) + 5 - low
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    lies = LinearNDInterpolator(one[seen] - low - 0.5, two[seen] - 0.5)
    place = lies(np.stack([columns, rows], axis=-1).reshape(-1, 2)).reshape(*size[::-1], 2)
    mask = _covered(fit, seen, one - low - 0.5, size) & np.isfinite(place).all(axis=-1)
    place = np.nan_to_num(place, nan=-9.0).astype(np.float32)
    first = _at(grey[0], np.stack([columns + low[0], rows + low[1]], axis=-1))
    flow, like = _flow(first, _at(grey[1], place), mask)
    inner = cv2.erode(mask.astype(np.uint8), np.ones((7, 7))) > 0
    numbers = np.flatnonzero(seen)
    at = np.rint(one[numbers] - low - 0.5).astype(int)
    column, row = np.clip(at, 0, size - 1).T
    move = flow[row, column]
    good = (inner & (like > LIKE))[row, column]
    good &= np.linalg.norm(move, axis=1) < FURTHEST * EYES_WIDE
    numbers, move = numbers[good], move[good]
    found = lies(one[numbers] - low - 0.5 + move) + 0.5
    known = np.isfinite(found).all(axis=1)
    numbers, found = numbers[known], found[known]
    if len(numbers) < 12:
        return None
    chosen = _spread(one[numbers], MOST)
    return numbers[chosen], one[numbers[chosen]] / scales[0], found[chosen] / scales[1]


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
