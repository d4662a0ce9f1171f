"""Irises of a painted face: dark discs between the lids, found on the paint itself.

A landmarker that was trained on photos puts an iris where a face ought to have it: it follows paint
by a part only. So the disc is looked for whose paint is darkest against what lies to its left and
right between the lids. Both eyes have discs of one size.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["irises_found"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

WIDTH = 64
"""Pixels between the corners of an eye in the picture of it that is looked at."""
HALF = 56, 36
"""Half the width and height of that picture."""
RADII = (0.16, 0.18, 0.2, 0.22, 0.24, 0.26)
"""Of an iris, over the width of its eye: people have 0.19 to 0.2."""
PLACES = 0.3, 0.04
"""How far from the middle of an eye's opening an iris may lie, to the side and up or down, over its
width."""
BESIDE = 1.1, 1.6
"""What lies beside a disc, in its radii; above and below are lids and lashes."""
BLUR = 0.03
"""Sigma, over the width of an eye: single strokes and glints are no irises."""
OPEN = 1.15
"""The outline of landmarks lies on the lids' edges or within: it is taken this much larger."""
SHOWN = 0.45
"""Share of an iris that shows between the lids, at least."""
LEAST = 0.9
"""Contrast of a disc and what is beside it, over the spread of an eye's tones and times the share
of the disc that shows, from which on discs are irises: mean of both eyes, half of it in each."""


@dataclass(frozen=True)
class _Eye:
    """A picture of an eye, its corners level.

    Attributes
    ----------
    luma
        float32 [2 * HALF[1] + 1, 2 * HALF[0] + 1], blurred.
    opening
        float32 of that shape, 1 between the lids.
    outline
        float64 [6, 2], pixels of the portrait.
    """

    luma: Float32
    opening: Float32
    outline: Float64


def irises_found(image: NDArray[np.uint8], landmarks: Float64) -> Float64 | None:
    """Middles of both irises.

    Parameters
    ----------
    image
        uint8 [H, W, 3], sRGB.
    landmarks
        [68, 2] pixels of a face that is seen from the front.

    Returns
    -------
    irises
        float64 [2, 2] pixels, of the picture's left eye first; None where an eye shows no disc.
    """
    seen = (_seen(image, np.asarray(landmarks[part], np.float64))
            for part in (slice(36, 42), slice(42, 48)))
    eyes = [eye for eye in seen if eye is not None]
    if len(eyes) < 2:
        return None
    best: tuple[float, list[Float64]] = (2 * LEAST, [])
    for radius in RADII:
        found = [_disc(eye, radius * WIDTH) for eye in eyes]
        total = sum(score for score, _ in found)
        if min(score for score, _ in found) > 0.5 * LEAST and total > best[0]:
            best = total, [place for _, place in found]
    if not best[1]:
        return None
    return np.stack([_in_portrait(eye, place) for eye, place in zip(eyes, best[1])])


def _frame(outline: Float64) -> tuple[Float64, Float64]:
    """Middle of an eye's corners, and what a pixel of its picture is in the portrait, [2, 2]."""
    along = (outline[3] - outline[0]) / WIDTH
    return 0.5 * (outline[0] + outline[3]), np.array([along, [-along[1], along[0]]])


def _in_portrait(eye: _Eye, place: Float64) -> Float64:
    """A place (x, y) from the middle of an eye's picture, in the portrait."""
    middle, axes = _frame(eye.outline)
    return np.asarray(middle + place @ axes, np.float64)


def _seen(image: NDArray[np.uint8], outline: Float64) -> _Eye | None:
    """The picture of an eye [6, 2]; None if it is too small or closed."""
    middle, axes = _frame(outline)
    if np.linalg.norm(axes[0]) * WIDTH < 8:
        return None
    to = np.linalg.inv(axes)
    inside = OPEN * ((outline - middle) @ to) + np.array(HALF)
    size = 2 * HALF[0] + 1, 2 * HALF[1] + 1
    way = np.concatenate([axes.T, (middle - np.array(HALF) @ axes - 0.5)[:, None]], axis=1)
    # Paint finer than the picture's pixels is mixed first.
    fine = max(float(np.linalg.norm(axes[0])), 1e-6)
    low = np.maximum(np.floor(middle - 1.2 * WIDTH * fine), 0).astype(int)
    high = np.minimum(np.ceil(middle + 1.2 * WIDTH * fine), image.shape[1::-1]).astype(int)
    if (high - low < 4).any():
        return None
    part = image[low[1]:high[1], low[0]:high[0]] @ np.array([0.299, 0.587, 0.114], np.float32)
    blurred = cv2.GaussianBlur(part, (0, 0), BLUR * WIDTH * fine)
    way[:, 2] -= low
    luma = cv2.warpAffine(blurred, way, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                          borderMode=cv2.BORDER_REPLICATE)
    opening = np.zeros(size[::-1], np.float32)
    cv2.fillPoly(opening, [np.round(inside * 16).astype(np.int32)], 1.0, shift=4)
    if opening.sum() < 0.08 * WIDTH ** 2:
        return None
    return _Eye(np.asarray(luma, np.float32), opening, outline)


def _disc(eye: _Eye, radius: float) -> tuple[float, Float64]:
    """Contrast of the best disc of a radius in an eye, and its place (x, y) from the middle."""
    reach = int(np.ceil(BESIDE[1] * radius))
    y, x = np.mgrid[-reach:reach + 1, -reach:reach + 1]
    away = np.hypot(x, y) / radius
    disc = (away < 1).astype(np.float32)
    beside = ((away > BESIDE[0]) & (away < BESIDE[1]) & (np.abs(y) < 0.7 * radius)
              ).astype(np.float32)
    inner, outer = (_mean(eye, kernel) for kernel in (disc, beside))
    spread = float(eye.luma[eye.opening > 0].std()) + 1.0
    # The more of a disc the lids leave open, the surer it is; one behind them is none.
    open_share = inner[1] / disc.sum()
    score = open_share * (outer[0] - inner[0]) / spread
    rows, columns = np.mgrid[-HALF[1]:HALF[1] + 1, -HALF[0]:HALF[0] + 1]
    rows = rows - np.average(rows, weights=eye.opening)
    score[(open_share < SHOWN) | (outer[1] < 0.5 * SHOWN * beside.sum())
          | (np.abs(columns) > PLACES[0] * WIDTH) | (np.abs(rows) > PLACES[1] * WIDTH)] = -np.inf
    row, column = np.unravel_index(int(score.argmax()), score.shape)
    place = np.array([column - HALF[0], row - HALF[1]], np.float64)
    return float(score[row, column]), place + _between(score, int(row), int(column))


def _mean(eye: _Eye, kernel: Float32) -> tuple[Float32, Float32]:
    """Mean tone of what a kernel covers of an eye's opening around each pixel, and how much."""
    total, covered = (cv2.filter2D(plane, -1, kernel, borderType=cv2.BORDER_CONSTANT)
                      for plane in (eye.luma * eye.opening, eye.opening))
    return np.asarray(total / np.maximum(covered, 1e-3), np.float32), np.asarray(covered)


def _between(score: NDArray[np.floating], row: int, column: int) -> Float64:
    """Where a parabola has its top around the best pixel, (x, y) in [-0.5, 0.5]."""
    out = np.zeros(2)
    for axis, (dy, dx) in enumerate(((0, 1), (1, 0))):
        one, two = score[row - dy, column - dx], score[row + dy, column + dx]
        bend = one + two - 2 * score[row, column]
        if np.isfinite(bend) and bend < 0:
            out[axis] = np.clip(0.5 * (one - two) / bend, -0.5, 0.5)
    return out
