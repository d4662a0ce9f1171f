"""Image quality: PSNR and SSIM as papers on radiance fields report them."""


import numpy as np

from .arrays import Array, Bool, Float64

_WINDOW = 11  # Width of SSIM's window in pixels.


def psnr(a: Array, b: Array, mask: Bool | None = None) -> float:
    """Peak signal-to-noise ratio in dB of two pictures in [0, 1]; infinite if they are equal.

    They are [H, W] or [H, W, C]; ``mask`` bool [H, W] has the pixels that count, by default all.
    """
    if a.shape != b.shape:
        raise ValueError(f"pictures of different shape: {a.shape} and {b.shape}")
    squared = (a.astype(np.float64) - b.astype(np.float64)) ** 2
    if mask is not None:
        squared = squared[mask]
    error = float(squared.mean())
    return float("inf") if error == 0 else -10.0 * float(np.log10(error))


def ssim(a: Array, b: Array) -> float:
    """Structural similarity of two pictures in [0, 1] (Wang et al. 2004).

    Gaussian window of 11 pixels, sigma 1.5, constants 0.01 and 0.03, mean over the channels and
    over the pixels whose window lies inside the picture, [H, W] or [H, W, C], at least 11 pixels
    each way.
    """
    if a.shape != b.shape:
        raise ValueError(f"pictures of different shape: {a.shape} and {b.shape}")
    import cv2

    if min(a.shape[:2]) < _WINDOW:
        raise ValueError(f"pictures of {a.shape[:2]} are smaller than SSIM's window of {_WINDOW}")

    def mean(plane: Float64) -> Float64:
        """Means over the windows that lie inside the picture."""
        side = _WINDOW // 2
        smooth = cv2.GaussianBlur(plane, (_WINDOW, _WINDOW), 1.5)
        return np.asarray(smooth[side:-side, side:-side])

    a, b = a.astype(np.float64), b.astype(np.float64)
    mean_a, mean_b = mean(a), mean(b)
    product, squares = mean_a * mean_b, mean_a * mean_a + mean_b * mean_b
    covariance, variances = mean(a * b) - product, mean(a * a + b * b) - squares
    alike = ((2.0 * product + 1e-4) * (2.0 * covariance + 9e-4)
             / ((squares + 1e-4) * (variances + 9e-4)))
    return float(alike.mean())
