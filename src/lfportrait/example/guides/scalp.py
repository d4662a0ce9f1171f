"""Regions of a photo: what is no hair, and what is not the person.

The network of the hair takes the shaded half of a shaven head for hair, and the lit half for skin;
and where it finds none, colors do so. Hair is rougher than skin, or of another color; a scalp is
neither. The network of the person takes things in the room for a part of the person.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ...labels import PICTURE_LABELS
from .color_segmentation import overlap
from .face_frame import FaceFrame
from .filters import broad_blur, disk, grey
from .regions import Regions, find_regions

__all__ = ["is_scalp", "photo_regions"]

Float32 = NDArray[np.float32]

SIZE, LARGE = 384, 512
"""Side of the picture that the network of the hair sees, and where the face is small in it."""
SMALL = 80.0
"""Pixels from the brows to the chin, in the picture that the network sees, of a small face."""
DENIED = 0.1
"""Where the network finds less hair than this, there is none, whatever colors say."""
NARROW = 0.11
"""What hangs on the person by no more than twice this, over that height, is no part of it."""
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

    What the person's network finds beside the person is left out, too.

    Parameters
    ----------
    photo
        uint8 or float in [0, 1], [H, W, 3].
    landmarks
        [68, 2].
    mask
        float32 [H, W], the person where it is known.
    """
    height = FaceFrame.of(np.asarray(landmarks, np.float64)).height
    size = SIZE if height * SIZE >= SMALL * max(photo.shape[:2]) else LARGE
    found = find_regions(photo, landmarks, mask, size=size, denied=DENIED)
    hair = found.hair
    if hair is not None and is_scalp(photo, found):
        hair = None
    if mask is not None:
        return Regions(found.landmarks, found.person, hair)
    person = _one_person(found)
    return Regions(found.landmarks, person, None if hair is None else np.minimum(hair, person))


def _one_person(regions: Regions) -> Float32:
    """The person [H, W] without what is apart from it, or hangs on it by a narrow bridge."""
    person = regions.person
    step = max(1, int(NARROW * regions.frame.height / 4))
    there = np.asarray(person[::step, ::step] > 0.5, np.uint8)
    kernel = disk(NARROW * regions.frame.height / step)
    count, parts = cv2.connectedComponents(cv2.erode(there, kernel))
    if count <= 2:
        return person
    inside = [parts[y, x] for x, y in (regions.landmarks[27:36] / step).astype(int)
              if 0 <= y < parts.shape[0] and 0 <= x < parts.shape[1]]
    own = np.bincount([part for part in inside if part], minlength=count)
    if not own.any():
        return person
    # Of what is narrow itself, a strand or a finger, the wide part next to it decides.
    ours, others = (distance_transform_edt(~part) for part in (
        parts == own.argmax(), (parts > 0) & (parts != own.argmax())))
    kept = np.asarray(ours <= others, np.float32)
    if kept[there > 0].all():
        return person
    return person * cv2.resize(kept, person.shape[::-1], interpolation=cv2.INTER_LINEAR)


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
