"""Hats and caps in a painting: what the networks take for hair or for background.

A sitter without one has hair and a background there. They must not be painted with a ribbon, or
with a brim that hovers behind the head.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..guides.filters import gaussian_blur
from .small_picture import FEATURES, GROUND, HAIR, SmallPicture

__all__ = ["has_two_hues", "part_headwear"]

Float32 = NDArray[np.float32]
Bools = NDArray[np.bool_]

FEW = 60
"""Fewer pixels than this have no color."""
BLUR = 0.03
"""Colors are compared blurred by so much over the face's size."""
TWO_HUES = 26.0
"""Hair whose two most frequent colors are further apart than this in a and b is a cap."""
BESIDE, LITTLE = 0.2, 0.2
"""The cap's color is what lies so near to the face, over its size; the other has so little there,
over what that has."""
EDGED = 1.3
"""A cap's paint is no further from its color than this times what is usual."""
COLORS, APART = (2, 3), 15.0
"""A background is divided into so many colors; a hat before it differs by this from the others."""
MEETING = 0.08
"""Head and background meet within this of each other, over the face's size."""
TOUCHING, BORDER, RARE = 0.25, 0.06, 0.01
"""A hat covers so much of the line where head and background meet, above the chin. Of the picture's
border, which is so broad over its size, it covers little: over that share, no more than this times
the difference of the colors."""


def part_headwear(small: SmallPicture, shares: Float32) -> None:
    """Let a cap's second color be no hair, and a hat beyond the head no background, in place.

    Both are painted nowhere (`FEATURES`).

    Parameters
    ----------
    small
        The painting, made small.
    shares
        float32 [h, w, 7] by `MATERIALS`, of the whole painting.
    """
    _part_cap(small, shares)
    _part_hat(small, shares)


def has_two_hues(small: SmallPicture, hair: Bools) -> bool:
    """Whether what is taken for hair, bool [h, w] of a small picture, is a cap with a ribbon.

    Hair has lights and shades, but one hue.
    """
    return _second_hue(small, hair) is not None


def _second_hue(small: SmallPicture, hair: Bools) -> Bools | None:
    """Where a cap has the hue that is not next to the face, bool [h, w]; None if it is hair."""
    if hair.sum() < FEW:
        return None
    colors = _colors(small, hair)
    found, middles = _clusters(colors, 2)
    if np.linalg.norm(np.diff(middles, axis=0)[0, 1:]) < TWO_HUES:
        return None
    beside = np.bincount(found[_grown(small.part(small.face) > 0.02, BESIDE * small.size)[hair]],
                         minlength=2)
    if beside.min() > LITTLE * beside.max():
        return None
    own = int(beside.argmax())
    # Nor is its edge, where skin and shade are mixed with it.
    away = np.linalg.norm(colors - middles[own], axis=1)
    other = np.zeros(hair.shape, bool)
    other[hair] = (found != own) | (away > EDGED * np.sqrt(np.mean(away[found == own] ** 2)))
    return other


def _part_cap(small: SmallPicture, shares: Float32) -> None:
    """A cap with a ribbon would become stripes of hair; the color next to the face stays."""
    other = _second_hue(small, small.part(shares[..., HAIR]) > 0.6)
    if other is not None:
        _nowhere(small, shares, HAIR, other)


def _part_hat(small: SmallPicture, shares: Float32) -> None:
    """What is taken for background, but lies around the head alone and is of its own color."""
    ground = small.part(shares[..., GROUND]) > 0.6
    if ground.sum() < FEW:
        return
    above = small.part(small.down) < 1
    meeting = ground & above & _grown(~ground & above, MEETING * small.size)
    width = max(2, round(BORDER * max(ground.shape)))
    border = np.ones(ground.shape, bool)
    border[width:, width:-width] = False
    border &= ground & above
    if min(meeting.sum(), border.sum()) < FEW:
        return
    colors = _colors(small, ground)
    for count in COLORS:
        found, middles = _clusters(colors, count)
        number = np.full(ground.shape, -1)
        number[ground] = found
        for one in range(count):
            touches, ends = (float((number[part] == one).mean()) for part in (meeting, border))
            away = np.linalg.norm(np.delete(middles, one, axis=0) - middles[one], axis=1).min()
            if touches > TOUCHING and away > APART and ends < RARE * away * touches:
                _nowhere(small, shares, GROUND, _hanging(number == one, meeting))
                return


def _hanging(part: Bools, meeting: Bools) -> Bools:
    """The pieces of a part [h, w] that meet the head."""
    _, pieces = cv2.connectedComponents(part.astype(np.uint8))
    known = np.unique(pieces[meeting & part])
    return np.isin(pieces, known[known > 0])


def _colors(small: SmallPicture, where: Bools) -> Float32:
    """Blurred colors of some pixels, Lab with half the lightness, float32 [N, 3]."""
    from skimage.color import rgb2lab

    colors = rgb2lab(np.clip(small.blurred(BLUR)[where], 0, 1)) * [0.5, 1.0, 1.0]
    return np.asarray(colors, np.float32)


def _clusters(colors: Float32, count: int) -> tuple[NDArray[np.int32], Float32]:
    """Which of the most frequent colors each has, int32 [N], and these, float32 [count, 3]."""
    stop = cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.1
    cv2.setRNGSeed(0)
    _, found, middles = cv2.kmeans(colors, count, np.empty(0, np.int32), stop, 3,
                                   cv2.KMEANS_PP_CENTERS)
    return np.asarray(found[:, 0], np.int32), np.asarray(middles, np.float32)


def _grown(part: Bools, radius: float) -> Bools:
    """A part [h, w] with the square of half a side ``radius`` around each pixel."""
    side = 2 * round(radius) + 1
    return np.asarray(cv2.dilate(part.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)


def _nowhere(small: SmallPicture, shares: Float32, material: int, part: Bools) -> None:
    """Take a part of a material out of use, in place."""
    soft = np.clip(2 * small.whole(gaussian_blur(part.astype(np.float32), 1.0)), 0, 1)
    taken = shares[..., material] * soft
    shares[..., FEATURES] += taken
    shares[..., material] -= taken
