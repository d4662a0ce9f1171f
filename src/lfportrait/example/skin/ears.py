"""Ears that a painting does not show keep the sitter's own relief.

Patches find no ear where the exemplar has its ears under hair, in the dark or outside the picture:
what they lay there is plain skin. A painter would draw the sitter's. So the light and shade of the
photos is laid over such paint, as strong as this painter models a face, and only as far as the
paint does not show it yet.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..guides.filters import grey
from .canvas import Canvas
from .sitter import Skin

__all__ = ["shade_ears"]

Float32 = NDArray[np.float32]

DARKEST = 0.03
"""Added to luma before its logarithm."""
FORCE = 1.0, 2.5
"""Bounds of how much stronger than the photos the painter models."""
LIMIT = 0.6
"""Bound of what is added to the logarithm."""


def shade_ears(skin: Skin, canvas: Canvas, color: Float32) -> None:
    """Lay the sitter's light and shade over ears that are painted without their relief.

    Parameters
    ----------
    skin
        Of the sitter, as the canvas has it.
    canvas
        Of the painting.
    color
        float32 [H, W, 3] in [0, 1], the painting; what owners show is changed.
    """
    weight = skin.ears * skin.seen
    if skin.hair is not None:
        weight = weight * (1 - skin.hair)
    own = canvas.own
    slots = canvas.slots[own]
    luma = canvas.gathered(grey(color), len(weight), np.nan)
    paint = np.log(np.maximum(luma, 0) + np.float32(DARKEST))
    photo = np.log(np.maximum(skin.tone + skin.detail, 0) + np.float32(DARKEST))
    known = np.isfinite(paint)
    face = known & skin.outwards & (skin.ears < 0.1) & (skin.seen > 0.5)
    if face.sum() < 100:
        return
    force = float(np.clip(paint[face].std() / max(float(photo[face].std()), 1e-3), *FORCE))
    more = np.zeros(len(weight), np.float32)
    for side in (skin.flat[:, 0] < 0, skin.flat[:, 0] >= 0):
        here = known & side & (weight > 0)
        if here.sum() < 100:
            continue
        relief, shown = (_centred(values[here], weight[here]) for values in (photo, paint))
        alike = float((weight[here] * relief * shown).sum()) / max(float(np.sqrt(
            (weight[here] * relief ** 2).sum() * (weight[here] * shown ** 2).sum())), 1e-6)
        more[here] = (1 - max(alike, 0.0)) * force * relief * weight[here]
    color[own] *= np.exp(np.clip(more, -LIMIT, LIMIT))[slots][:, None]
    np.minimum(color, 1, out=color)


def _centred(values: Float32, weight: Float32) -> Float32:
    """Values [N] without their weighted mean."""
    return np.asarray(values - np.average(values, weights=weight), np.float32)
