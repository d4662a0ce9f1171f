"""Painted eyes of which one cannot be made out: the other one's mirror image takes its place.

A painter leaves one eye in the shade, or hides it behind the rim of spectacles. In his painting
that is light; on another person's face, seen from all sides, it is a smear or a blind eye. So an
eye with much less contrast between white and iris than the other is painted as the other one is, in
the light and the color of its own surroundings. Iris and white are shifted, not mirrored: both eyes
look the same way.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from .exemplar import Exemplar
from .guides.regions import polygon
from .turned import FRONTAL

__all__ = ["eye_contrast", "with_even_eyes"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

EYES = slice(36, 42), slice(42, 48)
"""Landmarks of the eyes, the picture's left one first."""
TWIN = np.array([3, 2, 1, 0, 5, 4])
"""The landmarks of an eye's mirror image."""
EVEN = 0.57
"""An eye with less of the other's contrast than this is not made out. On eight old masters those
had 0.33 to 0.55 that one sees as smears, all others 0.74 or more; of fourteen frontal exemplars the
least has 0.58."""
SEEN = 0.12
"""An eye with less contrast than this is no better."""
LIGHT, DARK = 0.85, 0.12
"""Quantiles of the tones between the lids that stand for white and iris."""
WITHIN = 0.92
"""What is looked at is this much smaller than the lids' outline: not the lashes."""
CLOSED = 0.06
"""Lids that leave less open than this, over the square of an eye's width, are closed."""
FINE = 0.03
"""Blur of what is looked at, over an eye's width: finer strokes are the painter's hand."""
REACH = 0.72, 0.40, 0.46
"""Half width of what is painted, and its heights above and below an eye's middle, over the eye's
width: lids and bags, but no brow."""
SOFT, RING = 0.12, 1.3
"""Blur of its edge, over the eye's width; and how far around it light and color are read, over its
size."""
LIFTED = 0.3
"""Share of the light around that reaches an eye's middle."""


def with_even_eyes(exemplar: Exemplar) -> Exemplar:
    """The exemplar with both eyes as clear as the better one; itself where they nearly are.

    Faces that are turned stay as they are: their far eye is narrow. So does an eye that is closed.
    """
    if abs(exemplar.pose().yaw) >= FRONTAL:
        return exemplar
    outlines = [np.asarray(exemplar.landmarks[eye], np.float64) for eye in EYES]
    clear = [eye_contrast(exemplar.image, outline) for outline in outlines]
    weak = int(np.argmin(clear))
    if min(clear) == 0 or clear[1 - weak] < SEEN or clear[weak] > EVEN * clear[1 - weak]:
        return exemplar
    image = _as_the_other(exemplar.image, outlines[weak], outlines[1 - weak])
    return replace(exemplar, image=image, opened=exemplar)


def eye_contrast(image: NDArray[np.generic], outline: Float64) -> float:
    """Contrast of white and iris between the lids, in [0, 1]; 0 of an eye that is hardly open.

    Parameters
    ----------
    image
        uint8 or float in [0, 1], [H, W, 3], sRGB.
    outline
        [6, 2], landmarks of the eye in pixels.
    """
    middle = outline.mean(axis=0)
    size = float(np.linalg.norm(outline[3] - outline[0]))
    low = np.maximum(np.floor(middle - size).astype(int), 0)
    high = np.minimum(np.ceil(middle + size).astype(int), image.shape[1::-1])
    if (high - low < 4).any():
        return 0.0
    part = np.asarray(image[low[1]:high[1], low[0]:high[0]], np.float32)
    luma = part @ np.array([0.299, 0.587, 0.114], np.float32)
    if image.dtype == np.uint8:
        luma /= np.float32(255)
    luma = np.asarray(cv2.GaussianBlur(luma, (0, 0), max(FINE * size, 0.3)), np.float32)
    opening = polygon(part.shape, middle - low + WITHIN * (outline - middle)) > 0.5
    if opening.sum() < max(CLOSED * size ** 2, 12):
        return 0.0
    dark, light = np.quantile(luma[opening], (DARK, LIGHT))
    return float(light - dark)


def _as_the_other(image: NDArray[np.uint8], weak: Float64, clear: Float64) -> NDArray[np.uint8]:
    """The picture with the eye ``weak`` [6, 2] painted as the eye ``clear`` [6, 2] is."""
    size = float(np.linalg.norm(weak[3] - weak[0]))
    middle = weak.mean(axis=0)
    low = np.maximum(np.floor(middle - 1.5 * size).astype(int), 0)
    high = np.minimum(np.ceil(middle + 1.5 * size).astype(int), image.shape[1::-1])
    shape = high[1] - low[1], high[0] - low[0]
    rows, columns = np.mgrid[low[1]:high[1], low[0]:high[0]]
    places = np.stack([columns, rows], axis=-1) + 0.5
    # Lids and what is around them as in a mirror; white and iris as they look.
    mirrored, shifted = (_sampled(image, places @ way[:2] + way[2])
                         for way in (_affine(weak, clear[TWIN]), _affine(weak, clear)))
    opening = cv2.GaussianBlur(polygon(shape, weak - low), (0, 0), max(0.04 * size, 0.3))
    theirs = mirrored + opening[..., None] * (shifted - mirrored)
    ours = image[low[1]:high[1], low[0]:high[0]].astype(np.float32)
    away = _away(places, weak, size)
    # In the light around: what differs there goes on over the eye, but deep shade would hide it.
    ring = np.asarray((away > 1) & (away < RING), np.float32)
    reach = 0.5 * REACH[0] * size
    total = cv2.GaussianBlur(ring, (0, 0), reach)[..., None]
    light = cv2.GaussianBlur((ours - theirs) * ring[..., None], (0, 0), reach) / (total + 1e-4)
    light *= np.clip(LIFTED + (1 - LIFTED) * away, 0, 1)[..., None]
    share = cv2.GaussianBlur(np.asarray(away < 1, np.float32), (0, 0), max(SOFT * size, 0.3))
    out = image.copy()
    out[low[1]:high[1], low[0]:high[0]] = np.asarray(np.clip(
        ours + share[..., None] * (theirs + light - ours), 0, 255) + 0.5, np.uint8)
    return out


def _away(places: Float64, outline: Float64, size: float) -> Float64:
    """How far places [h, w, 2] are from an eye's middle: 1 at the edge of what is painted."""
    along = (outline[3] - outline[0]) / size
    beside = (places - outline.mean(axis=0)) @ np.stack([along, [-along[1], along[0]]], axis=1)
    wide, above, below = (part * size for part in REACH)
    high = np.where(beside[..., 1] < 0, above, below)
    return np.hypot(beside[..., 0] / wide, beside[..., 1] / high)


def _affine(places: Float64, others: Float64) -> Float64:
    """The affine map [3, 2] that leads from places [N, 2] to others [N, 2] by least squares."""
    known = np.concatenate([places, np.ones((len(places), 1))], axis=1)
    return np.asarray(np.linalg.lstsq(known, others, rcond=None)[0], np.float64)


def _sampled(image: NDArray[np.uint8], places: Float64) -> Float32:
    """A picture [H, W, 3] at places [h, w, 2] (x, y), float32 in [0, 255]."""
    x, y = np.moveaxis(np.asarray(places - 0.5, np.float32), -1, 0)
    return np.asarray(cv2.remap(image, np.ascontiguousarray(x), np.ascontiguousarray(y),
                                cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.float32)
