"""Extrapolate the painted face's light and shade to its surroundings.

Tones of patches come from the photo. Where the painter's light falls otherwise, the face ends in
his shade and they would begin in full light, or the reverse: a seam along the cheek.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..guides.filters import grey
from ..painter.light import BLUR, CELL, REACH, Cells
from .sitter import Canvas, Skin

__all__ = ["carried_light"]

Float32 = NDArray[np.float32]


def carried_light(skin: Skin, canvas: Canvas, core: NDArray[np.bool_], color: Float32,
                  tone: Float32) -> Float32:
    """How much lighter the face is painted than its tones ask for, carried on beside it.

    Parameters
    ----------
    skin
        Of the sitter, as the canvas has it.
    canvas
        Of the painting.
    core
        bool [N], places of the face that are painted.
    color
        float32 [H, W, 3] in [0, 1], its paint.
    tone
        float32 [N], the tones asked for.

    Returns
    -------
    light
        float32 [N], to be added to the tones; 0 in the face and far from it.
    """
    paint = canvas.gathered(grey(color), len(core))
    cells = Cells.over(skin.flat, CELL * skin.plane.height)
    light = cells.carried(paint - tone, core & skin.outwards, BLUR, REACH)
    return np.where(core, np.float32(0), light)
