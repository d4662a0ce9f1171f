"""Locate a head's ears: the parts that stand out near the ends of the jaw.

Landmarks give the approximate position of an ear; an ellipsoid around it would be a disk of skin in
the hair. So the head is carried on below it from around, and the ear is what lies further out, its
hollow included.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..painter.light import Cells
from ..surface_guide import HeadPlane

__all__ = ["ear_places"]

Float32 = NDArray[np.float32]

CELL = 0.02
"""Side of the cells that heights above the head are looked at in, over the face's height."""
STANDS_OUT = 0.035, 0.06
"""So far out an ear begins, and is one, over the face's height."""
HOLLOW = 4
"""An ear's hollow is less than twice so many cells wide."""
LEAST = 0.15
"""If no more of the ellipsoid stands out, there is hair over the ear, or its shape is not known."""


def ear_places(plane: HeadPlane, points: Float32, flat: Float32) -> Float32:
    """How much places are ears, float32 [N] in [0, 1].

    Parameters
    ----------
    plane
        The head's unwrapping, with its landmarks.
    points, flat
        float32 [N, 3] and [N, 2], places of the surface in the portrait frame and unwrapped, in
        world units.
    """
    near = _ellipsoids(plane, points)
    if not (near > 0).any() or not (near == 0).any():
        return near
    cells = Cells.over(flat, CELL * plane.height)
    aside = np.abs(points[:, 0] - np.float32(plane.origin[0]))
    least, most = STANDS_OUT
    head = cells.carried(aside, near == 0, 2.0, np.inf)
    out = np.clip(((aside - head) / np.float32(plane.height) - least) / (most - least), 0, 1)
    out = np.asarray(np.where(near > 0, out, 0), np.float32)
    for side in (points[:, 0] < plane.origin[0], points[:, 0] >= plane.origin[0]):
        here = side & (near > 0)
        if here.any() and out[here].mean() < LEAST:
            out[here] = 1
    return near * np.maximum(out, cells.closed(out, HOLLOW))


def _ellipsoids(plane: HeadPlane, points: Float32) -> Float32:
    """Soft ellipsoids behind the ends of the jaw, from the brows to below the nose, [N]."""
    out = np.zeros(len(points), np.float32)
    landmarks, height = plane.landmarks, plane.height
    brows, foot = float(plane.origin[1]), float(np.nanmean(landmarks[31:36, 1]))
    for end, side in ((0, -1.0), (16, 1.0)):
        if not np.isfinite(landmarks[end]).all():
            continue
        middle = np.array([landmarks[end, 0] + 0.05 * side * height, 0.4 * brows + 0.6 * foot,
                           landmarks[end, 2] - 0.3 * height], np.float32)
        reach = np.float32(height) * np.array([0.24, 0.28, 0.22], np.float32)
        away = np.sqrt((((points - middle) / reach) ** 2).sum(-1))
        out = np.maximum(out, np.clip((np.float32(1.15) - away) / np.float32(0.2), 0, 1))
    return np.asarray(out, np.float32)
