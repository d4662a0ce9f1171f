"""A sitter's beard in a photo: hair below the cheeks, which the networks take for skin."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ...labels import PICTURE_LABELS
from ..guides.filters import gaussian_blur, skin_distance
from ..guides.regions import Regions
from .picture_materials import CLOTHES, FEATURES, HAIR, NECK, SKIN

__all__ = ["grow_beard"]

Float32 = NDArray[np.float32]
Bools = NDArray[np.bool_]

FACE = 60.0
"""Pixels from the brows to the chin in the picture that is looked at."""
CHEEKS, CHIN, REACH = (0.12, 0.45), (0.78, 0.98), (0.3, 2.2)
"""Cheeks, a chin and all of a beard lie between these (brows 0, chin 1)."""
ASIDE = 0.75, 0.4, 1.25
"""And so far from the middle, over half the face's width."""
BARE = 2.3
"""A chin nearer to the cheeks' colors than this, in standard deviations, is bare, or in shade."""
NEARER = 0.6
"""A beard's distance from the colors of the hair is no more than this share of that from skin's."""
FEW = 30
"""Fewer pixels than this have no color."""


def grow_beard(photo: NDArray[np.uint8], regions: Regions, labels: NDArray[np.uint8],
               shares: Float32) -> None:
    """Let a beard be hair, in place: what hangs together with a chin that is as the hair is.

    Parameters
    ----------
    photo, regions, labels
        uint8 [H, W, 3], and its regions and labels (uint8 [H, W, len(PICTURE_LABELS)]).
    shares
        float32 [H, W, 7] by `MATERIALS`.
    """
    step = max(1, int(regions.frame.height / FACE))
    part = shares[::step, ::step]
    size = part.shape[1], part.shape[0]
    colors = cv2.resize(photo, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    right, down = (plane[::step, ::step] for plane in regions.frame.local(shares.shape[:2]))
    half = 0.5 * regions.frame.width / regions.frame.height
    lips = labels[::step, ::step, PICTURE_LABELS.index("lips")] > 60
    bare = (part[..., SKIN] > 0.9) & (part[..., FEATURES] < 0.05) & ~lips
    cheeks, chin, low = ((down > high) & (down < deep) & (np.abs(right) < aside * half)
                         for (high, deep), aside in zip((CHEEKS, CHIN, REACH), ASIDE))
    cheeks, chin = cheeks & bare, chin & ~lips
    hair = (part[..., HAIR] > 0.8) & (down < CHEEKS[1])
    low &= (part[..., [SKIN, NECK, CLOTHES]].sum(axis=-1) > 0.02) & ~lips
    if min(one.sum() for one in (cheeks, chin, hair)) < FEW:
        return
    chosen = cheeks | chin | hair | low
    to_skin, to_hair = (np.zeros(chosen.shape, np.float32) for _ in range(2))
    for away, sample in ((to_skin, cheeks), (to_hair, hair)):
        away[chosen] = skin_distance(colors[chosen], sample[chosen], 1.0)
    of_chin = float(np.median(to_skin[chin]))
    if of_chin < BARE or np.median(to_hair[chin]) > NEARER * of_chin:
        return
    _, pieces = cv2.connectedComponents((low & (to_hair < NEARER * to_skin)).astype(np.uint8))
    known = np.unique(pieces[chin])
    beard = np.isin(pieces, known[known > 0]).astype(np.float32)
    whole = cv2.resize(gaussian_blur(beard, 0.7), shares.shape[1::-1],
                       interpolation=cv2.INTER_LINEAR)
    for material in (SKIN, NECK, CLOTHES):
        moved = shares[..., material] * whole
        shares[..., material] -= moved
        shares[..., HAIR] += moved
