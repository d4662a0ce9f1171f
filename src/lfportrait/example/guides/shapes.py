"""Shapes that masks are widened, narrowed and smoothed with."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["disk", "grown"]

Bools = NDArray[np.bool_]


def disk(radius: float) -> NDArray[np.uint8]:
    """A filled disk for morphology, uint8 [n, n]; ``radius`` in pixels, at least 1."""
    side = 2 * max(1, round(radius)) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


def grown(part: Bools, radius: float) -> Bools:
    """A part of a picture, bool [h, w], with all that is as near as ``radius`` pixels."""
    return np.asarray(cv2.dilate(part.astype(np.uint8), disk(radius)) > 0)
