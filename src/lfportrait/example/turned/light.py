"""Relight the mirrored side of a face.

A strip of the far cheek that a painter showed from the side is too narrow for strokes, but it shows
the light there: shade, its hue, a reflection. So mirrored strokes take the broad colors of his own
paint wherever he showed any, and what lies behind goes on from there.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Sides", "blurred", "relit"]

Float32 = NDArray[np.float32]

DARK = 24.0
"""Added to values before their logarithm: the darkest paint is no blacker than that."""
UNLIKE = 0.6
"""Difference of logarithms, mean of the channels, that is hardly one of light alone."""
SMALL = 8
"""Light changes slowly: it is looked at in pictures of this fraction of the size."""
BROAD, ALONG = 0.04, 0.06
"""Blurs, in units of the head, in which light is looked at, and how wide a seam is."""
UTMOST = 0.05
"""No light makes paint brighter or darker than this share of what the painter saw of the face."""


@dataclass(frozen=True)
class Sides:
    """A frontal picture, a painter's own paint on one side, its mirror image on the other.

    Attributes
    ----------
    ours, theirs
        float32 [h, w, 3], sRGB in [0, 255]: his own paint, and the mirror image's.
    share
        float32 [h, w] in [0, 1], of his own.
    both
        float32 [h, w], where either is on the face and was seen at all.
    face
        float32 [h, w], the face; light changes nothing of hair and hats around it.
    hair
        float32 [h, w], what of his own paint is hair; None where that is not known.
    scale
        Pixels per unit of the head.
    """

    ours: Float32
    theirs: Float32
    share: Float32
    both: Float32
    face: Float32
    hair: Float32 | None
    scale: float


def relit(sides: Sides) -> Float32:
    """The relit mirror image, float32 [h, w, 3].

    What differs broadly between own and mirrored paint, where both are skin, is the light. From
    there it goes on and fades: a lit cheek does not end at a line of shadow.
    """
    scale, broad = sides.scale, BROAD * sides.scale
    bare = sides.both
    if sides.hair is not None:
        bare = bare * np.clip(1 - 2 * np.maximum(sides.hair, sides.hair[:, ::-1]), 0, 1)
    known = np.maximum(blurred(bare, broad), np.float32(1e-3))
    # Light multiplies: a brighter cheek makes no grey of a black hat beside it.
    brightness = [np.log(np.maximum(one, 0) + DARK) for one in (sides.ours, sides.theirs)]
    differing = blurred(bare[..., None] * (brightness[0] - brightness[1]), broad)
    differing = np.asarray(differing / known[..., None], np.float32)
    asked = _asked(sides, bare)
    if not asked.any():
        return sides.theirs
    # What is much darker or brighter may be hair or a hat over skin, and gets little weight.
    weight_told = asked * np.exp(-(differing.mean(axis=-1) / UNLIKE) ** 2)
    weight, most, light, clear, own, mirrored = (_small(plane) for plane in (
        weight_told, asked, differing, np.maximum(sides.face * (sides.share > 0.9), weight_told),
        *(blurred(one, broad) for one in brightness)))
    mean = _spread(light, weight, most, scale / SMALL)
    seen = clear > 0.5
    if seen.any():
        low, high = np.quantile(own[seen], (UTMOST, 1 - UTMOST), axis=0)
        mean = np.clip(mirrored + mean, np.minimum(low, mirrored),
                       np.maximum(high, mirrored)) - mirrored
    change = cv2.resize(np.asarray(mean, np.float32), sides.ours.shape[1::-1],
                        interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.exp(brightness[1] + sides.face[..., None] * change) - DARK, np.float32)


def _asked(sides: Sides, bare: Float32) -> Float32:
    """Where light is looked for, float32 [h, w]: at the seam, and beyond it wherever ``bare``."""
    seam = blurred(4 * sides.share * (1 - sides.share), ALONG * sides.scale)
    seam = seam / max(float(seam.max()), 1e-3)
    return np.asarray(bare * np.maximum(seam, 1 - sides.share), np.float32)


def _spread(light: Float32, weight: Float32, most: Float32, unit: float) -> Float32:
    """Light [h, w, 3] known by weights [h, w], carried on to where it is not; ``unit`` in pixels.

    From broad to narrow: near what is known that counts, further away a mean of more. ``most``
    [h, w] are the weights if all of it were known.
    """
    mean: Float32 = np.zeros_like(light)
    for reach in (0.4, 0.2, 0.1, 0.05):
        total = blurred(weight, reach * unit)[..., None]
        here = blurred(light * weight[..., None], reach * unit) / (total + np.float32(1e-5))
        enough = 0.2 * float(blurred(most, reach * unit).max())
        sure = np.clip(total / (enough + 1e-6), 0, 1)
        mean = np.asarray(mean + sure * (here - mean), np.float32)
    return mean


def _small(plane: Float32) -> Float32:
    """A plane made small."""
    size = max(plane.shape[1] // SMALL, 8), max(plane.shape[0] // SMALL, 8)
    return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), np.float32)


def blurred(picture: Float32, sigma: float) -> Float32:
    """A picture blurred by a Gaussian of ``sigma`` pixels."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.float32)
