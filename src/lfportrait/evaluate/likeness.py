"""Likeness: is the stylised head still the person, and does it look like the exemplar's paint.

Identity: landmarks found in the stylised view against those in the real one. Contours: correlation
of the gradients of both. Manner: how far small patches of the result are from the nearest patch of
the exemplar. All are plain figures without training; features and FID are in `features`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

__all__ = ["contour_correlation", "identity", "landmark_error", "patch_fidelity"]

Detector = Callable[[NDArray[np.uint8]], NDArray[np.float64] | None]

_OUTER_EYES = (36, 45)
_INNER = slice(17, 68)


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


def _patches(image: NDArray[Any], size: int) -> NDArray[np.float32]:
    """All patches of a picture in CIE Lab, float32 [h, w, 3, size, size]."""
    from skimage.color import rgb2lab

    values = image.astype(np.float64) / 255.0 if image.dtype == np.uint8 else image
    lab = rgb2lab(np.clip(values, 0.0, 1.0)).astype(np.float32)
    return np.lib.stride_tricks.sliding_window_view(lab, (size, size), axis=(0, 1))


def patch_fidelity(image: NDArray[Any], exemplar: NDArray[Any],
                   mask: NDArray[np.bool_] | None = None, *, size: int = 7, samples: int = 600,
                   seed: int = 0) -> float:
    """Mean distance of a picture's patches to their nearest patches of the exemplar.

    Exact search over all patches of the exemplar, for a sample of the picture's.

    Parameters
    ----------
    image, exemplar
        [H, W, 3] and [H', W', 3], uint8 or float in [0, 1].
    mask
        bool [H, W], where the middles of the patches may lie; everywhere by default.
    size
        Side of a patch in pixels, odd.
    samples
        Patches looked up.
    seed
        Seed of the sample.

    Returns
    -------
    distance
        Root mean square difference in CIE Lab over a patch's pixels (delta E), mean over the
        patches; 0 for a picture copied from the exemplar. NaN where the mask leaves nothing.
    """
    source, wanted = _patches(exemplar, size), _patches(image, size)
    half = size // 2
    allowed = np.ones(wanted.shape[:2], bool)
    if mask is not None:
        allowed = np.asarray(mask, bool)[half:half + wanted.shape[0], half:half + wanted.shape[1]]
    places = np.argwhere(allowed)
    if not len(places):
        return float("nan")
    chosen = np.random.default_rng(seed).permutation(len(places))[:samples]
    rows, columns = places[np.sort(chosen)].T
    queries = wanted[rows, columns].reshape(len(rows), -1)
    best = np.full(len(queries), np.inf, np.float32)
    for row in range(0, source.shape[0], 8):
        block = source[row:row + 8].reshape(-1, queries.shape[1])
        # |q - p|^2 = |q|^2 - 2 q.p + |p|^2; the first term is added at the end.
        distances = np.einsum("pd,pd->p", block, block)[None] - 2.0 * (queries @ block.T)
        np.minimum(best, distances.min(axis=1), out=best)
    squared = np.maximum(best + np.einsum("qd,qd->q", queries, queries), 0.0)
    return float(np.sqrt(squared / (size * size)).mean())
