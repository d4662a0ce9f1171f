"""Image quality: PSNR and SSIM as papers on radiance fields report them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

__all__ = ["psnr", "ssim"]


def psnr(a: NDArray[Any], b: NDArray[Any], mask: NDArray[np.bool_] | None = None) -> float:
    """Peak signal-to-noise ratio in dB of two pictures in [0, 1]; infinite if they are equal.

    Parameters
    ----------
    a, b
        [H, W] or [H, W, C], float in [0, 1].
    mask
        bool [H, W]: the pixels that count; all by default.
    """
    if a.shape != b.shape:
        raise ValueError(f"pictures of different shape: {a.shape} and {b.shape}")
    squared = (a.astype(np.float64) - b.astype(np.float64)) ** 2
    if mask is not None:
        squared = squared[mask]
    error = float(squared.mean())
    return float("inf") if error == 0 else -10.0 * float(np.log10(error))


def ssim(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Structural similarity of two pictures in [0, 1] (Wang et al. 2004).

    Gaussian window of 11 pixels, sigma 1.5, constants 0.01 and 0.03, mean over the channels and
    over the pixels whose window lies inside the picture.

    Parameters
    ----------
    a, b
        [H, W] or [H, W, C], float in [0, 1], at least 11 pixels each way.
    """
    if a.shape != b.shape:
        raise ValueError(f"pictures of different shape: {a.shape} and {b.shape}")
    x, y = np.atleast_3d(a.astype(np.float64)), np.atleast_3d(b.astype(np.float64))

    def blur(image: NDArray[np.float64]) -> NDArray[np.float64]:
        return ndimage.gaussian_filter(image, (1.5, 1.5, 0), truncate=3.5)

    mean_x, mean_y = blur(x), blur(y)
    variance_x = blur(x * x) - mean_x ** 2
    variance_y = blur(y * y) - mean_y ** 2
    covariance = blur(x * y) - mean_x * mean_y
    c1, c2 = 0.01 ** 2, 0.03 ** 2
    values = ((2 * mean_x * mean_y + c1) * (2 * covariance + c2)
              / ((mean_x ** 2 + mean_y ** 2 + c1) * (variance_x + variance_y + c2)))
    return float(values[5:-5, 5:-5].mean())
