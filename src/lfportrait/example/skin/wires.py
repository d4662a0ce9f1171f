"""Spectacles of a sitter on a head: thin, and well before what is around them.

On the skin they would be painted as skin, which they are not, and their thin lines broken up. They
have the painter's dark instead, as far as they are darker than the sitter's cheeks in the photo.
"""

from __future__ import annotations

import cv2
import numpy as np

from ...arrays import Float32
from ..mouth import Palette
from .sitter import Skin

THIN = 0.045  # A line before the face is thinner than this, over the height from brows to chin.
BEFORE = 0.015, 0.035  # What stands out so far begins to be a wire, and is one; likewise.
HEIGHTS = -0.15, 0.5  # Wires are between these (brows 0, chin 1).
LEAST = 0.01  # Less than this share of a face is dust; over the square of that height.
SKIN = 0.2, 0.7, 0.5
"""Cheeks are between these heights (brows 0, chin 1), and so far aside at most (radians)."""


def wires(skin: Skin) -> Float32:
    """How far places are the wires of spectacles, float32 [N] in [0, 1]."""
    return skin.cached("wires", lambda: _wires(skin))


def _wires(skin: Skin) -> Float32:
    unit = skin.plane.height
    depth = np.array(skin.atlas.depth, np.float32)
    there = np.isfinite(depth)
    out = np.zeros(len(skin.index), np.float32)
    if not there.any():
        return out
    towards = -depth
    towards[~there] = towards[there].min()
    side = 2 * round(THIN * unit * skin.pixels / 2) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    hat = (towards - cv2.morphologyEx(towards, cv2.MORPH_OPEN, disc)).reshape(-1)[skin.index]
    down = skin.flat[:, 1] / unit
    asked = (down > HEIGHTS[0]) & (down < HEIGHTS[1]) & (skin.ears < 0.2)
    if skin.hair is not None:
        asked &= skin.hair < 0.5
    begins, ends = BEFORE
    out[asked] = np.clip((hat[asked] / unit - begins) / (ends - begins), 0, 1)
    if (out > 0.5).sum() < LEAST * (unit * skin.pixels) ** 2:
        out[:] = 0
    return out


def painted_wires(skin: Skin, paint: Float32, light: Float32, palette: Palette) -> Float32:
    """Paint [N, 3] in [0, 1] with the wires of spectacles; the same array where there are none.

    ``light`` [N] is the photo's.
    """
    share = wires(skin)
    down = skin.flat[:, 1] / skin.plane.height
    cheeks = (down > SKIN[0]) & (down < SKIN[1]) & (share == 0) & skin.outwards
    cheeks &= np.abs(skin.flat[:, 0]) < SKIN[2] * skin.plane.radius
    if not (share.any() and cheeks.any()):
        return paint
    lit = np.clip(light / max(float(np.median(light[cheeks])), 1e-3), 0, 1)[:, None]
    colors = palette.black + lit * (palette.cheeks - palette.black)
    return np.asarray(paint + share[:, None] * (colors - paint), np.float32)
