"""Image quality: PSNR and SSIM as papers on radiance fields report them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    from skimage.metrics import structural_similarity

    return float(structural_similarity(
        a.astype(np.float64), b.astype(np.float64), data_range=1.0, gaussian_weights=True,
        use_sample_covariance=False, channel_axis=2 if a.ndim == 3 else None))
