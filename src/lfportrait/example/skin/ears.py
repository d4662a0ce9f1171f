"""Ears of a sitter: located on the head, and their relief where a painting does not show it.

Landmarks give the approximate position of an ear; an ellipsoid around it would be a disk of skin in
the hair. So the head is carried on below it from around, and the ear is what lies further out, its
hollow included.

Patches find no ear where the exemplar has its ears under hair, in the dark or outside the picture:
what they lay there is plain skin. A painter would draw the sitter's. So the light and shade of the
photos is laid over such paint, as strong as this painter models a face, and only as far as the
paint does not show it yet.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Bool, Float32
from ..painter.light import Cells
from ..surface_guide import HeadPlane

CELL = 0.02
"""Side of the cells that heights above the head are looked at in, over the face's height."""
STANDS_OUT = 0.035, 0.06
"""What stands out so far begins to be an ear, and is one, over the face's height."""
HOLLOW = 4  # An ear's hollow is less than twice so many cells wide.
LEAST = 0.15
"""If no more of the ellipsoid stands out, there is hair over the ear, or its shape is not known."""
DARKEST = 0.03  # Added to luma before its logarithm.
FORCE = 1.0, 2.5  # Bounds of how much stronger than the photos the painter models.
LIMIT = 0.6  # Bound of what is added to the logarithm.


def ear_places(plane: HeadPlane, points: Float32, flat: Float32) -> Float32:
    """How much places are ears, float32 [N] in [0, 1].

    Of places of the surface in the portrait frame, float32 [N, 3], and unwrapped, [N, 2]; world
    units.
    """
    near = _ellipsoids(plane, points)
    if not (near > 0).any() or not (near == 0).any():
        return near
    cells = Cells.over(flat, CELL * plane.height)
    aside = np.abs(points[:, 0] - np.float32(plane.origin[0]))
    least, most = STANDS_OUT
    head = cells.extrapolated(aside, near == 0, 2.0, np.inf)
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


def missing_relief(ears: Float32, face: Bool, across: Float32, photo: Float32,
                   paint: Float32) -> Float32 | None:
    """Factors [N] of paint that give ears their relief; None where too little is known.

    ``ears`` are float32 [N] in [0, 1] and ``face`` bool [N], both as photos saw them; ``across``
    are places from the left (below 0) to the right, ``photo`` and ``paint`` luma in [0, 1], NaN
    where nothing is painted.
    """
    paint, photo = (np.log(np.maximum(luma, 0) + np.float32(DARKEST)) for luma in (paint, photo))
    known = np.isfinite(paint)
    face = known & face
    if face.sum() < 100:
        return None
    force = float(np.clip(paint[face].std() / max(float(photo[face].std()), 1e-3), *FORCE))
    more = np.zeros(len(ears), np.float32)
    for side in (across < 0, across >= 0):
        here = known & side & (ears > 0)
        if here.sum() < 100:
            continue
        relief, shown = (_centered(values[here], ears[here]) for values in (photo, paint))
        alike = float((ears[here] * relief * shown).sum()) / max(float(np.sqrt(
            (ears[here] * relief ** 2).sum() * (ears[here] * shown ** 2).sum())), 1e-6)
        more[here] = (1 - max(alike, 0.0)) * force * relief * ears[here]
    return np.asarray(np.exp(np.clip(more, -LIMIT, LIMIT)), np.float32)


def _centered(values: Float32, weight: Float32) -> Float32:
    """Values [N] without their weighted mean."""
    return np.asarray(values - np.average(values, weights=weight), np.float32)
