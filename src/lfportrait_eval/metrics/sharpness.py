"""Whether the strokes of a rendered view are as sharp as those that were painted.

A field is fitted to painted pictures, or colored from a painted chart, and its lattice is coarser
than the paint. Gradient energy is the mean squared difference of neighbouring pixels' luma: the
energy of the picture's spectrum, weighted by frequency squared. Blur lowers it. Rendered over
wanted, 1 keeps all detail; above 1 something was added: seams, noise, steps of the lattice. What
was painted has to be seen through a filter that keeps its detail, too (Lanczos): between pixels a
bilinear look-up loses up to two thirds of the finest.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .repeats import luma

__all__ = ["gradient_energy", "sharpness"]


def _energy(plane: NDArray[np.float32], counts: NDArray[np.bool_]) -> float:
    """Mean squared gradient over the pixels that count together with their next two."""
    here = counts[:-1, :-1] & counts[1:, :-1] & counts[:-1, 1:]
    if not here.any():
        return float("nan")
    right = plane[:-1, 1:][here] - plane[:-1, :-1][here]
    down = plane[1:, :-1][here] - plane[:-1, :-1][here]
    return float((right.astype(np.float64) ** 2 + down.astype(np.float64) ** 2).mean())


def gradient_energy(picture: NDArray[Any], mask: NDArray[np.bool_]) -> float:
    """Mean squared gradient of a picture's luma over a mask.

    Parameters
    ----------
    picture
        [H, W, 3], uint8 or float in [0, 1]; NaN where it is unknown.
    mask
        bool [H, W], the pixels that count. A silhouette inside it counts as detail: erode it.

    Returns
    -------
    energy
        Luma squared per pixel squared, >= 0, by forward differences: of each pixel that is known
        and in the mask together with those to its right and below. NaN without any.

    Raises
    ------
    ValueError
        If picture and mask differ in size.
    """
    if picture.shape[:2] != mask.shape:
        raise ValueError(f"a picture {picture.shape} needs a mask of its size, not {mask.shape}")
    plane = luma(picture)
    return _energy(plane, np.asarray(mask, bool) & np.isfinite(plane))


def sharpness(rendered: NDArray[Any], wanted: NDArray[Any], mask: NDArray[np.bool_], *,
              margin: int = 3) -> float:
    """Gradient energy of a rendered view over that of what was painted, seen in the same view.

    Parameters
    ----------
    rendered
        [H, W, 3], uint8 or float in [0, 1].
    wanted
        [H, W, 3], what was painted; NaN where it is unknown. Its values beside the head don't
        matter.
    mask
        bool [H, W], the head.
    margin
        Pixels that the mask is eroded by, so that no silhouette counts. Holes of ``wanted`` are not
        widened: only differences between known pixels count, the same ones in both pictures.

    Returns
    -------
    ratio
        >= 0; 1 where both are equally sharp. NaN where nothing is left to compare, or where
        ``wanted`` is flat.

    Raises
    ------
    ValueError
        If the pictures and the mask differ in size.
    """
    if not rendered.shape[:2] == wanted.shape[:2] == mask.shape:
        raise ValueError(f"pictures {rendered.shape} and {wanted.shape} and a mask {mask.shape} "
                         "must have one size")
    planes = [luma(picture) for picture in (rendered, wanted)]
    inside = np.asarray(mask, bool)
    if margin > 0:
        # The picture's own border is no silhouette.
        inside = ndimage.binary_erosion(inside, np.ones((3, 3), bool), margin, border_value=1)
    counts = inside & np.isfinite(planes[0]) & np.isfinite(planes[1])
    ours, theirs = (_energy(plane, counts) for plane in planes)
    # A thousandth of a grey level is rounding.
    return ours / theirs if theirs > (1e-3 / 255) ** 2 else float("nan")
