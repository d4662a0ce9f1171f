"""Split a photo's luma for the patches: tone, detail, and edge strength."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..guides.filters import broad_blur, gaussian_blur

__all__ = ["BLUR", "contours"]

Float32 = NDArray[np.float32]

BLUR = 0.06
"""Sigma of the blur that separates detail from light, over the face's size (`face_size`)."""
CONTOUR = 0.016
"""Detail of this strength (root mean square of luma) counts half."""


def contours(values: Float32, inside: Float32, size: float) -> tuple[Float32, Float32]:
    """Luma without grain, and edge strength (edges and patterns), float32 [H, W] each.

    Parameters
    ----------
    values, inside
        float32 [H, W], luma times the weight of a pixel, and that weight.
    size
        Of the face in pixels.
    """
    sigma = BLUR * size
    soft = gaussian_blur(values, 0.2 * sigma)
    soft /= np.maximum(gaussian_blur(inside, 0.2 * sigma), np.float32(1e-3))
    near = broad_blur(values, 0.6 * sigma)
    near /= np.maximum(broad_blur(inside, 0.6 * sigma), np.float32(1e-3))
    fine = (soft - near) * inside
    energy = broad_blur(fine * fine, 0.5 * sigma)
    return soft, np.asarray(energy / (energy + np.float32(CONTOUR ** 2)), np.float32)
