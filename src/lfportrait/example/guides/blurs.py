"""Gaussian blurs, narrow and wide, and pictures reduced to means of blocks."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..kernels.guides import shrink

__all__ = ["broad_blur", "enlarged", "gaussian_blur", "gaussian_taps", "shrunk"]

Float32 = NDArray[np.float32]


def gaussian_taps(sigma: float) -> Float32:
    """Gaussian of unit sum, cut at 3 sigma."""
    radius = max(1, int(np.ceil(3 * sigma)))
    taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return np.asarray(taps / taps.sum(), np.float32)


def gaussian_blur(image: Float32, sigma: float) -> Float32:
    """Gaussian blur of [H, W] with mirrored borders; kernel cut at 3 sigma."""
    taps = gaussian_taps(sigma)
    return np.asarray(cv2.sepFilter2D(image, -1, taps, taps, borderType=cv2.BORDER_REFLECT),
                      np.float32)


def broad_blur(image: Float32, sigma: float) -> Float32:
    """`gaussian_blur` for wide kernels: on block means, and bilinear between.

    The blocks are at most half of ``sigma`` wide, so the result is within a hundredth of the
    largest step in the picture.
    """
    factor = int(sigma / 2)
    if factor < 2:
        return gaussian_blur(image, sigma)
    # Block means and the interpolation blur, too.
    rest = np.sqrt(max(sigma ** 2 - factor ** 2 / 4, 0.25)) / factor
    return enlarged(gaussian_blur(shrunk(image, factor), rest), factor, image.shape)


def shrunk(image: Float32, factor: int) -> Float32:
    """Means of blocks of ``factor`` x ``factor`` pixels, float32 [ceil(H / f), ceil(W / f)]."""
    if factor == 1:
        return image
    out = np.empty((-(-image.shape[0] // factor), -(-image.shape[1] // factor)), np.float32)
    shrink(np.ascontiguousarray(image, np.float32), factor, out)
    return out


def enlarged(image: Float32, factor: int, shape: tuple[int, ...]) -> Float32:
    """Means of blocks of ``factor`` pixels at all pixels of a picture (H, W), bilinear."""
    image = np.ascontiguousarray(image, np.float32)
    if factor == 1:
        return image
    size = image.shape[1] * factor, image.shape[0] * factor
    whole = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR)[:shape[0], :shape[1]]
    # Where the blocks end before the picture, their last value goes on.
    down, across = (shape[axis] - whole.shape[axis] for axis in (0, 1))
    return np.asarray(cv2.copyMakeBorder(whole, 0, down, 0, across, cv2.BORDER_REPLICATE),
                      np.float32)
