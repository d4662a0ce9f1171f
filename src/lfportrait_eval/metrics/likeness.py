"""Likeness: whether the stylised head is still the person.

Identity: landmarks found in the stylised view against those in the real one. Contours: correlation
of the gradients of both. Both are plain figures without training; patches are in `patches`,
features and FID in `features`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.draw import polygon2mask

__all__ = ["Detector", "contour_correlation", "face_region", "identity", "landmark_error"]

Detector = Callable[[NDArray[np.uint8]], NDArray[np.float64] | None]

_OUTER_EYES = (36, 45)
_INNER = slice(17, 68)


def face_region(shape: tuple[int, ...], landmarks: NDArray[np.floating]) -> NDArray[np.bool_]:
    """The face between jaw and brows, which every method paints; bool [H, W]."""
    outline = np.concatenate([landmarks[:17], landmarks[17:27][::-1]])
    return np.asarray(polygon2mask(shape[:2], outline[:, ::-1]), bool)


def landmark_error(found: NDArray[np.floating], wanted: NDArray[np.floating]) -> float:
    """Mean distance of the 51 inner landmarks over the distance of the outer eye corners.

    Parameters
    ----------
    found, wanted
        [68, 2] pixels, iBUG order. Normalised by ``wanted``'s eyes.
    """
    eyes = float(np.linalg.norm(wanted[_OUTER_EYES[0]] - wanted[_OUTER_EYES[1]]))
    return float(np.linalg.norm(found[_INNER] - wanted[_INNER], axis=1).mean()) / max(eyes, 1e-9)


def identity(stylised: Sequence[NDArray[np.uint8]], real: Sequence[NDArray[np.uint8]],
             detect: Detector) -> dict[str, float]:
    """Landmark error between stylised and real pictures of the same views.

    Parameters
    ----------
    stylised, real
        uint8 [H, W, 3] each, pairs of the same view.
    detect
        Picture -> landmarks [68, 2] or None; e.g. `lfportrait.face.detect_landmarks`.

    Returns
    -------
    figures
        ``nme`` (mean over the views where both faces are found, NaN if there is none),
        ``detected`` (share of the faces found in the real views that are found in the stylised
        ones), ``views`` (faces found in the real views).
    """
    errors, views = [], 0
    for painted, photo in zip(stylised, real, strict=True):
        wanted = detect(photo)
        if wanted is None:
            continue
        views += 1
        found = detect(painted)
        if found is not None:
            errors.append(landmark_error(found, wanted))
    return {"nme": float(np.mean(errors)) if errors else float("nan"),
            "detected": len(errors) / views if views else float("nan"), "views": views}


def contour_correlation(a: NDArray[Any], b: NDArray[Any], mask: NDArray[np.bool_]) -> float:
    """Correlation in [-1, 1] of the gradient magnitudes (grey, sigma 1.5) of two pictures.

    Parameters
    ----------
    a, b
        float [H, W, 3].
    mask
        bool [H, W], the pixels that count.
    """
    strengths = [ndimage.gaussian_gradient_magnitude(
        np.asarray(image, np.float64) @ (0.299, 0.587, 0.114), 1.5)[mask] for image in (a, b)]
    if min(strength.std() for strength in strengths) < 1e-9:
        return float("nan")
    return float(np.corrcoef(strengths)[0, 1])
