"""Tones: the luma of colors, one distribution of it given another's shape, chroma kept in range.

Colors are planes, float32 [3, ...], sRGB in [0, 1]. Luma is Rec. 601's, and chroma the difference
of a color from the grey of its luma: what is added to all three channels changes the luma alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["BINS", "LUMA", "colored", "luma", "matching_curve", "tone_histogram", "toned"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

BINS = 1024
"""Bins of a histogram of luma; matched values are finer, as they are interpolated in it."""

LUMA = np.array([0.299, 0.587, 0.114], np.float32)
"""Shares of red, green and blue in Rec. 601's luma."""


def luma(planes: Float32) -> Float32:
    """Rec. 601 luma of colors [3, ...], float32 [...]."""
    red, green, blue = LUMA
    return red * planes[0] + green * planes[1] + blue * planes[2]


def tone_histogram(values: Float32, weights: Float32) -> Float64:
    """Weighted histogram of values in [0, 1], float64 [BINS]."""
    index = np.minimum((values * np.float32(BINS)).astype(np.int32), BINS - 1)
    return np.asarray(np.bincount(index, weights, BINS), np.float64)


def matching_curve(source: Float64, target: Float64) -> Float32:
    """The rising curve that gives values of one histogram the distribution of another.

    Parameters
    ----------
    source, target
        `tone_histogram` of the values as they are and of those that they are to be like.

    Returns
    -------
    float32 [BINS]
        What values at the middle of each bin become, for `toned`; the values themselves where one
        of the histograms is empty.
    """
    middles = (np.arange(BINS) + 0.5) / BINS
    if source.sum() <= 0 or target.sum() <= 0:
        return middles.astype(np.float32)
    # A bin stands for the middle of its share: many equal values get the median of the tones that
    # they take up, not the darkest of them.
    ranks = (np.cumsum(source) - 0.5 * source) / source.sum()
    below = np.concatenate([[0.0], np.cumsum(target) / target.sum()])
    wanted = np.interp(ranks, below, np.arange(BINS + 1) / BINS)
    # Empty bins say nothing of their own; what lies at a full one's edge leans on them, though.
    held = source > 0
    return np.interp(middles, middles[held], wanted[held]).astype(np.float32)


def toned(values: Float32, curve: Float32) -> Float32:
    """Values in [0, 1] by a curve of `matching_curve`, linear between its points."""
    place = np.clip(values * np.float32(BINS) - np.float32(0.5), 0, BINS - 1)
    index = np.minimum(place.astype(np.int32), BINS - 2)
    return curve[index] + (place - index.astype(np.float32)) * np.diff(curve)[index]


def colored(light: Float32, chroma: Float32) -> Float32:
    """Colors of a given luma and chroma.

    Chroma that leads out of the range of colors is drawn in, all channels alike: unlike clipping
    each for itself this keeps the luma and the hue.

    Parameters
    ----------
    light
        float32 [...], luma in [0, 1].
    chroma
        float32 [3, ...], colors less their luma.

    Returns
    -------
    float32 [3, ...] in [0, 1].
    """
    least = np.float32(1e-6)
    up = np.maximum(np.maximum(chroma[0], chroma[1]), chroma[2])
    down = np.minimum(np.minimum(chroma[0], chroma[1]), chroma[2])
    share = np.minimum((1 - light) / np.maximum(up, least), light / np.maximum(-down, least))
    return np.clip(light + np.minimum(share, np.float32(1)) * chroma, 0, 1)
