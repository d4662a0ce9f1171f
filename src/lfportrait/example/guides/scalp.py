"""Remove false hair from a photo's regions.

The network of the hair takes the shaded half of a shaven head for hair, and the lit half for skin.
Hair is rougher than skin, or of another color; a scalp is neither.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ...labels import PICTURE_LABELS
from .appearance import grey
from .blurs import broad_blur
from .color_segmentation import overlap
from .regions import Regions, find_regions

__all__ = ["is_scalp", "photo_regions"]

Float32 = NDArray[np.float32]

SIZE = 384
"""Side of the picture that the network of the hair sees."""
FACE = 100.0
"""Pixels from the brows to the chin in the picture that is looked at."""
FINE = 0.02
"""What is finer than this over that height is texture."""
SMOOTH = 1.0
"""Hair of skin's colors is rougher than this times skin."""
LIKE = 0.6
"""Overlap of its colors with the skin's: smooth hair shares less."""
SURE = 0.2
"""Share of what may be hair that is hair rather than not; a head of hair has more of it."""
SHADE = 0.5
"""A scalp in the shade is not darker than this over the face's skin."""
LEAST = 30
"""Pixels that suffice for a decision."""


def photo_regions(photo: NDArray[np.generic], landmarks: NDArray[np.floating],
                  mask: Float32 | None = None) -> Regions:
    """Segment a photo: `find_regions`, without hair where that is a bare scalp.

    Parameters
    ----------
    photo
        uint8 or float in [0, 1], [H, W, 3].
    landmarks
        [68, 2].
    mask
        float32 [H, W], the person where it is known.
    """
    found = find_regions(photo, landmarks, mask, size=SIZE)
    if found.hair is None or not is_scalp(photo, found):
        return found
    return Regions(found.landmarks, found.person, None)


def is_scalp(photo: NDArray[np.generic], regions: Regions) -> bool:
    """Whether what is taken for hair in a photo, [H, W, 3], has the looks of skin."""
    assert regions.hair is not None
    ratio = min(1.0, FACE / max(regions.frame.height, 1.0))
    size = tuple(max(round(n * ratio), 1) for n in photo.shape[1::-1])
    colors, person, hair = (
        np.asarray(cv2.resize(np.asarray(plane, np.float32), size,
                              interpolation=cv2.INTER_AREA), np.float32)
        for plane in (photo, regions.person, regions.hair))
    colors *= np.float32(1 / 255 if photo.dtype == np.uint8 else 1)
    hair *= person
    sure = (hair > 0.7).sum() > SURE * (hair > 0.2).sum()
    small = Regions(regions.landmarks * ratio, person, hair)
    skin = small.labels()[..., PICTURE_LABELS.index("skin")] > 230
    # Edges of either are rough, whatever lies between them.
    kernel = np.ones((5, 5), np.uint8)
    scalp, skin = (cv2.erode(np.asarray(one, np.uint8), kernel) > 0
                   for one in (hair > 0.7, skin & (hair < 0.05)))
    if min(scalp.sum() if sure else hair.sum(), skin.sum()) < LEAST:
        return False
    shared = overlap(colors, np.asarray(scalp, np.float32) if sure else hair,
                     np.asarray(skin, np.float32))
    if not sure:
        return shared > LIKE
    luma = grey(colors)
    rough = np.abs(luma - broad_blur(luma, FINE * FACE))
    return bool(shared > LIKE and np.median(luma[scalp]) > SHADE * np.median(luma[skin])
                and rough[scalp].mean() < SMOOTH * rough[skin].mean())
