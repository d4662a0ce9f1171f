"""Visibility of a head's places in a painting."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...face import GENERIC_LANDMARKS, FacePose, generic_depth, symmetric_landmarks

__all__ = ["clearness", "head_oval", "in_front", "painted_places"]

Float64 = NDArray[np.float64]

STEP, HARDLY = 0.02, 0.1
"""Step for the slope of the head's surface, in its units; and how little a place may move in the
painting, over its way on the head, squared, before that is held back."""
RELIEF = 0.01
"""Distance of the points of the relief that hides parts of the head, in its units."""


def painted_places(points: Float64, painted: Float64, pose: FacePose,
                   head: Float64 = GENERIC_LANDMARKS) -> Float64:
    """Where a painting with landmarks [68, 2] has points [h, w, 3] of a head, [h, w, 2].

    By the pose, and by a smooth warp of what it leaves over of the landmarks. ``head`` [68, 3] are
    the head's own.
    """
    from scipy.interpolate import RBFInterpolator

    known = np.isfinite(painted).all(axis=1)
    # On the far side the jaw's landmarks slide along the outline: the pose knows better.
    far = GENERIC_LANDMARKS[:, 0] * np.sign(pose.rotation[2, 0]) < 0
    known &= ~(far & (np.arange(68) < 17))
    left = painted[known] - pose.project(head[known])
    warp = RBFInterpolator(head[known, :2], left, kernel="thin_plate_spline",
                           smoothing=2e-3)
    flat = points.reshape(-1, 3)
    moves = warp(flat[:, :2]).reshape(*points.shape[:2], 2)
    # Outside the face the residuals fade: there is nothing that they were measured on.
    low, high = head[8, 1], head[17:27, 1].max()
    reach = np.sqrt((points[..., 0] / head[16, 0]) ** 2
                    + ((points[..., 1] - (low + high) / 2) / (0.5 * (high - low))) ** 2)
    fade = np.exp(-(np.maximum(reach - 1.1, 0) / 0.5) ** 2)
    limit = 0.3 * pose.scale
    return np.asarray(pose.project(points)
                      + fade[..., None] * np.clip(moves, -limit, limit), np.float64)


def in_front(way: NDArray[np.floating], painted: NDArray[np.floating], pose: FacePose) -> Float64:
    """How far places beside landmarks lie from these in the frontal picture, float64 [68, 2].

    Parameters
    ----------
    way
        [68, 2], pixels, from the landmarks to the places in the painting.
    painted
        [68, 2], the landmarks.
    pose
        Of the face in the painting.
    """
    head = symmetric_landmarks(painted, pose)
    x, y = head[:, 0], head[:, 1]
    turn = pose.rotation[:2]
    # How a place in the painting moves with one on the head's surface, seen from the front.
    along = np.stack([turn[:, k] + turn[:, 2] * (
        generic_depth(x + dx, y + dy, head) - generic_depth(x - dx, y - dy, head))[:, None] / (
            2 * STEP) for k, (dx, dy) in enumerate(((STEP, 0.0), (0.0, STEP)))], axis=-1)
    along *= np.outer([1.0, -1.0], [1.0, -1.0])  # pixels count downwards
    # What is hardly seen from there would move far.
    back = np.swapaxes(along, 1, 2)
    found = np.linalg.solve(back @ along + HARDLY * np.eye(2), back @ np.asarray(way)[..., None])
    return np.asarray(found[..., 0], np.float64)


def clearness(points: Float64, pose: FacePose, head: Float64 = GENERIC_LANDMARKS) -> Float64:
    """How clearly the painter saw points [h, w, 3]: cosine to his direction, 0 if hidden, [h, w].

    The points are a height field, rows downwards, of the head with landmarks ``head`` [68, 3].
    """
    facing = np.asarray(_normals(points) @ pose.rotation[2], np.float64)
    facing[_hidden(points, pose, head)] = 0.0
    return facing


def _normals(points: Float64) -> Float64:
    """Unit normals of a height field of points [h, w, 3], +z outwards; rows run downwards."""
    down, across = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normal = np.cross(-down, across) * -1.0
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True), np.float64)


def _hidden(points: Float64, pose: FacePose, head: Float64) -> NDArray[np.bool_]:
    """Which points [h, w, 3] the painter sees something else before, bool [h, w].

    A ray to him runs below the head's surface somewhere.
    """
    surface, low = _relief(head.tobytes())
    out = np.zeros(points.shape[:2], bool)
    for along in np.arange(0.02, 1.2, 2 * RELIEF):
        ahead = points + along * pose.rotation[2]
        inside = head_oval(ahead[..., 0], ahead[..., 1], 0.47, 0.02, 0.7) < 1
        ahead = ahead[inside]
        row, column = ((ahead[:, axis] - low[axis]) / RELIEF for axis in (1, 0))
        found = ndimage.map_coordinates(surface, [row, column], order=1, cval=-np.inf)
        out[inside] |= found - ahead[:, 2] > 0.005
    return out


@lru_cache(maxsize=4)
def _relief(head: bytes) -> tuple[Float64, tuple[float, float]]:
    """Depth of a head every `RELIEF` units, [y, x], and (x, y) of its first point.

    ``head`` are the bytes of its landmarks, float64 [68, 3].
    """
    low = (-0.55, -0.8)
    x, y = np.meshgrid(np.arange(low[0], 0.56, RELIEF), np.arange(low[1], 0.81, RELIEF))
    return generic_depth(x, y, np.frombuffer(head).reshape(68, 3)), low


def head_oval(x: Float64, y: Float64, wide: float, middle: float, high: float) -> Float64:
    """Distance from the middle of an oval about the axis, 1 on it."""
    return np.asarray(np.sqrt((x / wide) ** 2 + ((y - middle) / high) ** 2), np.float64)
