"""Strands of hair that no photo shows: they run down from the crown, as strong as those it shows.

Without them hair behind would be as smooth as a helmet. They are noise that is long in the
direction in which hair falls, in octaves of a strand's width, each with its contrast in the photo.
"""

from __future__ import annotations

import itertools

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float32, Float64

__all__ = ["WIDTHS", "strand_contrast", "strands"]


WIDTHS = (0.016, 0.032, 0.064, 0.128)
"""Widths of strands (3 to 26 mm), portrait units."""
LENGTH = 12.0
"""How long they are over their widths."""
CROWN, AROUND = -0.25, 0.5
"""Where they start (depth, forward), and how far from there they are as wide as that."""
DARKEST = 0.02
"""Added to luminance before its logarithm."""
MOST = 0.25
"""Contrast of one octave at most: beyond, a photo shows highlights rather than strands."""


def strand_contrast(colors: NDArray[np.floating], hair: Bool, pixels: float) -> Float64:
    """Standard deviations of the logarithm of hair's luminance by octaves of `WIDTHS`, [4].

    Parameters
    ----------
    colors : [H, W, 3] in [0, 1].
    hair : bool [H, W].
    pixels : Of a portrait unit.
    """
    factor = min(1.0, 4.0 / (WIDTHS[0] * pixels))
    size = tuple(max(2, round(side * factor)) for side in hair.shape[::-1])
    light = cv2.resize(np.asarray(colors, np.float32).mean(axis=2), size,
                       interpolation=cv2.INTER_AREA)
    light = np.log(light + np.float32(DARKEST))
    inside = cv2.resize(hair.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.99
    known = inside.astype(np.float32)

    def mean(width: float) -> Float32:
        sigma = 0.3 * width * pixels * factor
        return np.asarray(cv2.GaussianBlur(light * known, (0, 0), sigma)
                          / np.maximum(cv2.GaussianBlur(known, (0, 0), sigma), 1e-3), np.float32)

    if not inside.any():
        return np.zeros(len(WIDTHS))
    means = [mean(width) for width in (*WIDTHS, 2 * WIDTHS[-1])]
    # What differs by more than most of it is no strand, but a parting or an edge.
    return np.array([min(MOST, 1.5 * float(np.median(np.abs((fine - wide)[inside]))))
                     for fine, wide in itertools.pairwise(means)])


def strands(points: Float64, contrast: Float64) -> Float64:
    """Factors [N] of the brightness of places [N, 3] (portrait frame) in hair."""
    turn = np.arctan2(points[:, 0], CROWN - points[:, 2]) / (2 * np.pi) + 0.5
    out = np.zeros(len(points))
    random = np.random.default_rng(7)
    for width, strength in zip(WIDTHS, contrast, strict=True):
        # A period of noise is about two widths: a strand and the next.
        across = max(4, round(2 * np.pi * AROUND / width))
        down = (2.0 - points[:, 1]) / (LENGTH * width)
        lattice = random.standard_normal((int(4.0 / (LENGTH * width)) + 3, across))
        lattice = np.pad(lattice, ((0, 0), (2, 2)), mode="wrap")
        at = np.stack([np.clip(down, 0, len(lattice) - 1), turn * across + 2])
        out += strength * ndimage.map_coordinates(lattice, at, order=2, mode="nearest")
    return np.asarray(np.exp(out))
