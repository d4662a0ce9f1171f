"""What a single photo shows that a head which is fitted to its face can't have: said beforehand."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import models
from ..arrays import Float64, UInt8

__all__ = ["face_faults"]

_COVERED = 0.5
"""Share of either half of a face under hair from which it counts."""
_HAND = 0.15
"""Share of a face that must be skin of the body for a hand to be there."""
_STRIP = 0.25
"""Share of both halves below which one is not looked at."""
_HALVES = ([27, 28, 29, 30, 33, 31, 3, 2, 1, 0, 17, 18, 19, 20, 21],
           [27, 28, 29, 30, 33, 35, 13, 14, 15, 16, 26, 25, 24, 23, 22])
"""Landmarks around the halves of a face between brows and nose: no beard grows there."""
_WHOLE = [*range(1, 6), 57, *range(11, 16), *range(26, 16, -1)]
"""Around a face without the lowest part of the jaw, as a throat is body, too."""


def _share(mask: NDArray[np.floating], points: Float64) -> float:
    """How much of a polygon is covered by a mask."""
    inside = np.zeros(mask.shape, np.uint8)
    cv2.fillPoly(inside, [np.round(points).astype(np.int32)], 1)
    return float((mask[inside > 0] > 0.5).mean()) if inside.any() else 0.0


def face_faults(image: UInt8, landmarks: Float64, name: str) -> list[str]:
    """Sentences about what lies before a face in a photo; empty where nothing does.

    Parameters
    ----------
    image
        uint8 [H, W, 3], sRGB.
    landmarks
        float64 [68, 2], pixels.
    name
        Of the photo.
    """
    from ..example import spectacles
    from ..face import hair_mask, parts

    found = []
    if not models.missing(["hair-segmentation"]):
        hair = hair_mask(image)
        sizes = [cv2.contourArea(landmarks[half].astype(np.float32)) for half in _HALVES]
        # Of a turned face the far half is a strip.
        share = max(_share(hair, landmarks[half]) for half, size in zip(_HALVES, sizes)
                    if size > _STRIP * sum(sizes))
        if share > _COVERED:
            found.append(f"hair covers {100 * share:.0f} % of one half of the face in {name}: it "
                         "becomes paint on the skin; a photo with the hair combed back is better")
    if not models.missing(["multiclass-segmentation"]):
        share = _share(parts(image)["body-skin"], landmarks[_WHOLE])
        if share > _HAND:
            found.append(f"a hand seems to lie at the face in {name}: it becomes paint on the "
                         "skin; use a photo without it")
    if spectacles(image, landmarks).any():
        found.append(f"glasses in {name} become paint on the skin; a photo without them is better")
    return found
