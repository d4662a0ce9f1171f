"""Whether both corners of a painted mouth are painted alike.

A painter who shows his sitter from the side leaves the far corner of the mouth to guessing: it may
end in a smear, or in a streak to the chin of what lay beside the face. The sitter's corners mirror
each other; so should the paint, as far as the painter's own strokes let it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.color import rgb2lab

__all__ = ["corner", "corners_found", "painters_corners", "unlike"]

Float64 = NDArray[np.float64]

OUTWARD, DOWN = (-0.15, 0.3), (-0.2, 0.45)
"""What is compared around a corner, over the width of the mouth: its way to the chin as well."""
SIZE = 48, 36
"""Rows and columns of it."""
BLUR = 0.04
"""Sigma of the blur before, over the mouth's width: single strokes are no smears."""
LEAST = 2.0
"""Contrast (delta E) that paint is taken to have at least."""
TURNED = 0.7, 0.9
"""Half a mouth over its other half: up to here a face is turned, and from here on frontal."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 48, 54, 51, 57


def corner(image: NDArray[np.uint8], landmarks: NDArray[np.floating], left: bool,
           width: float | None = None) -> Float64:
    """The surroundings of a corner of the mouth, without light that falls off evenly.

    Parameters
    ----------
    image, landmarks
        uint8 [H, W, 3] and [68, 2].
    left
        Of the picture's left corner; else of the right one. Both are turned so that the cheek is
        on the right.
    width
        Of the mouth in pixels; by default that of the landmarks.

    Returns
    -------
    float64 [*SIZE, 3], Lab.
    """
    points = np.asarray(landmarks, np.float64)
    along = points[_RIGHT] - points[_LEFT]
    length = max(float(np.linalg.norm(along)), 1e-9)
    width = length if width is None else width
    right = along / length
    down = np.array([-right[1], right[0]])
    out = -right if left else right
    u, v = np.meshgrid(np.linspace(*OUTWARD, SIZE[1]), np.linspace(*DOWN, SIZE[0]))
    at = points[_LEFT if left else _RIGHT] + width * (u[..., None] * out + v[..., None] * down)
    low = np.maximum(np.floor(at.min(axis=(0, 1)) - width * 4 * BLUR), 0).astype(int)
    high = np.ceil(at.max(axis=(0, 1)) + width * 4 * BLUR).astype(int) + 1
    part = image[low[1]:high[1], low[0]:high[0]] / np.float64(255)
    if min(part.shape[:2]) < 2:
        return np.full((*SIZE, 3), np.nan)
    part = ndimage.gaussian_filter(part, (BLUR * width, BLUR * width, 0))
    x, y = np.moveaxis(at - low, -1, 0) - 0.5
    lab = rgb2lab(np.clip(np.stack([ndimage.map_coordinates(
        part[..., c], [y, x], order=1, mode="nearest") for c in range(3)], axis=-1), 0, 1))
    # Light from one side brightens one cheek, the more so the further out.
    plane = np.stack([np.ones(u.size), u.ravel(), v.ravel()], axis=1)
    fit, *_ = np.linalg.lstsq(plane, lab.reshape(-1, 3), rcond=None)
    return np.asarray(lab - (plane @ fit).reshape(lab.shape), np.float64)


def _contrast(patch: Float64) -> float:
    """Root mean square of a patch, delta E."""
    return float(np.sqrt((patch ** 2).sum(axis=-1).mean()))


def unlike(image: NDArray[np.uint8], landmarks: NDArray[np.floating]) -> float:
    """Difference (delta E) of both corners of a mouth; of unrelated ones, their contrast."""
    left, right = (corner(image, landmarks, side) for side in (True, False))
    return _contrast(left - right) / np.sqrt(2)


def painters_corners(image: NDArray[np.uint8], landmarks: NDArray[np.floating],
                     ) -> tuple[float, float]:
    """What a painting shows of a mouth's corners.

    Parameters
    ----------
    image, landmarks
        The painting, uint8 [H, W, 3], and its [68, 2].

    Returns
    -------
    contrast, own
        Delta E: contrast of the corner that it shows best; and how unlike both are by the painter's
        own hand, 0 for a face that is turned, whose corners can't be compared.
    """
    points = np.asarray(landmarks, np.float64)
    middle = 0.5 * (points[_TOP] + points[_BOTTOM])
    halves = [float(np.linalg.norm(points[k] - middle)) for k in (_LEFT, _RIGHT)]
    near = halves[0] >= halves[1]
    patch = corner(image, points, near, 2 * max(halves))
    frontal = (min(halves) / max(*halves, 1e-9) - TURNED[0]) / (TURNED[1] - TURNED[0])
    return _contrast(patch), unlike(image, points) * float(np.clip(frontal, 0, 1))


def corners_found(painted: NDArray[np.uint8], landmarks: NDArray[np.floating], contrast: float,
                  own: float = 0.0) -> dict[str, float]:
    """How unlike both corners of a painted mouth are.

    Parameters
    ----------
    painted
        uint8 [H, W, 3].
    landmarks
        [68, 2] pixels of the sitter in the same view. Light makes his own corners unlike; that is
        not looked at, as painters do not follow it.
    contrast, own
        `painters_corners` of the painting.

    Returns
    -------
    figures
        ``mouth``: difference of the mirrored corners, less the painter's own (as variances), over
        the painting's contrast there. Mirror images have 0; what has nothing in common but its
        contrast has 1.
    """
    more = unlike(painted, landmarks) ** 2 - own ** 2
    return {"mouth": float(np.sqrt(max(more, 0.0))) / max(contrast, LEAST)}
