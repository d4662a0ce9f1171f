"""Find hair by its relief: curls of stone or bronze have the color of the face.

Where the crown is much rougher than forehead and cheeks, what is as rough as the crown and hangs
together with it is hair. A shaven or veiled head has no such crown.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..painter.light import Cells
from ..surface_guide import HeadPlane
from .regions import hair_by_place

__all__ = ["around_face", "hair_by_relief"]

Float32 = NDArray[np.float32]

CELL, BLUR = 0.02, 2.0
"""Side of the cells that roughness is measured in, over the face's height; its blur in cells."""
CURLS = 0.08
"""Gaps and specks less than twice so wide are none; over the face's height."""
ROUGH, ROUGHER = 0.5, 1.6
"""A crown of curls has so strong contours, so many times those of forehead and cheeks."""
LIMIT = 0.4
"""What is rougher than this share of the way from skin to crown is hair."""
LOWEST = -1.1
"""Curls end here at the latest (up from the brows, in the face's heights): below the chin."""
REACH = 20.0
"""What photos saw is carried on so many cells; further on hair is where most heads have it."""


def around_face(plane: HeadPlane, flat: Float32, lowest: float) -> NDArray[np.bool_]:
    """Where a head may have hair, bool [N]: around the face, down to ``lowest`` behind.

    Parameters
    ----------
    plane, flat
        The head's unwrapping, and places [N, 2] in it.
    lowest
        How far hair hangs below the brows, in units of the face's height upwards.
    """
    up, angle = -flat[:, 1] / plane.height, np.abs(flat[:, 0]) / plane.radius
    # Above the brows; towards the temples hair grows further down.
    above = up > 0.35 - 0.25 * np.clip((angle - 0.4) / 0.3, 0, 1)
    return np.asarray(above | (angle > 0.9) & (up > lowest))


def hair_by_relief(plane: HeadPlane, flat: Float32, contours: Float32, seen: Float32,
                   ears: Float32) -> Float32 | None:
    """Hair as what is as rough as the crown, float32 [N] in [0, 1]; None if that is smooth.

    Parameters
    ----------
    plane, flat
        The head's unwrapping, and places [N, 2] in it.
    contours, seen, ears
        float32 [N] in [0, 1]: strength of edges and patterns, how well photos saw a place, ears.
    """
    up, angle = -flat[:, 1] / plane.height, np.abs(flat[:, 0]) / plane.radius
    shown = seen > 0.5
    crown, forehead = shown & (up > 0.7), shown & (angle < 0.6) & (up > 0.15) & (up < 0.45)
    cheeks = shown & (angle > 0.25) & (angle < 0.8) & (up > -0.75) & (up < -0.15)
    if min(part.sum() for part in (crown, forehead, cheeks)) < 100:
        return None
    rough, *smooth = (float(np.median(contours[part])) for part in (crown, forehead, cheeks))
    if rough < max(ROUGH, ROUGHER * max(smooth)):
        return None
    cells = Cells.over(flat, CELL * plane.height)
    step = rough - max(smooth)
    lean = (contours - max(smooth) - LIMIT * step) / (0.2 * step)
    begin = np.where(shown, np.float32(0.5), hair_by_place(plane, flat))
    hair = np.clip(begin + cells.carried(lean, shown, BLUR, REACH), 0, 1)
    hair *= around_face(plane, flat, LOWEST) * (1 - ears)
    reach = round(CURLS / CELL)
    hair = cells.joined(cells.opened(cells.closed(hair.astype(np.float32), reach), reach), crown)
    return np.asarray(np.clip(3 * hair - 1, 0, 1) * (1 - ears), np.float32)
