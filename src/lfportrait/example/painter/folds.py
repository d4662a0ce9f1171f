"""The photo's light and shade on painted clothes.

A painter's white shirt or black coat has no paint for the folds, patches and zips of what a sitter
wears: patches of it alone are a flat shape. Where the paint does not have the photo's light and
shade, it becomes lighter or darker as paint does: no further than to white and black, its hue kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..guides.filters import broad_blur, gaussian_blur

__all__ = ["with_folds"]

Float32 = NDArray[np.float32]

CONTRAST = 0.45
"""Contrast of the photo (of log odds of luma) that painted clothes have at the least."""
FINE, BROAD = 0.012, 0.03
"""Blurs of the photo and of its paint before they are compared, over the face's size."""
UTMOST = 1.6
"""Nothing becomes lighter or darker by more than this, in log odds."""
LEAST = 0.03
"""Black and white are this far from 0 and 1."""
FEW = 100
"""Fewer pixels are no clothes."""


def with_folds(color: Float32, luma: Float32, worn: Float32, size: float) -> Float32:
    """A painted picture whose clothes have at least the photo's light and shade.

    Parameters
    ----------
    color
        float32 [H, W, 3] in [0, 1], the painted picture.
    luma
        float32 [H, W] in [0, 1], of the photo.
    worn
        float32 [H, W] in [0, 1], how far it shows clothes.
    size
        Of the face in pixels.

    Returns
    -------
    float32 [H, W, 3] in [0, 1]; the same array where nothing is worn.
    """
    rows, columns = (np.flatnonzero((worn > 0.02).any(axis=axis)) for axis in (1, 0))
    if (worn > 0.5).sum() < FEW:
        return color
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    worn = np.ascontiguousarray(worn[box])
    paint = color[box]
    inside = worn > 0.5
    asked = _odds(gaussian_blur(np.ascontiguousarray(luma[box]), max(0.5, FINE * size)))
    there = paint @ np.array([0.299, 0.587, 0.114], np.float32)
    there = _odds(broad_blur(there * worn, BROAD * size)
                  / np.maximum(broad_blur(worn, BROAD * size), np.float32(1e-3)))
    asked = np.float32(CONTRAST) * (asked - np.median(asked[inside]))
    lacking = asked - (there - np.median(there[inside]))
    # Not more than asked for, and nothing against it: the rest are the painter's own strokes.
    lacking = np.clip(lacking, np.minimum(asked, 0), np.maximum(asked, 0))
    lacking = np.clip(lacking, -UTMOST, UTMOST) * worn
    out = color.copy()
    chosen = worn > 0.02
    colors = _odds(paint[chosen]) + lacking[chosen][:, None]
    # Exact where nothing is lacking, black and white included.
    out[box][chosen] += 1 / (1 + np.exp(-colors)) - np.clip(paint[chosen], LEAST, 1 - LEAST)
    return np.clip(out, 0, 1, out=out)


def _odds(values: NDArray[np.floating]) -> Float32:
    """Log odds of values in [0, 1]."""
    values = np.clip(values, np.float32(LEAST), np.float32(1 - LEAST))
    return np.asarray(np.log(values / (1 - values)), np.float32)
