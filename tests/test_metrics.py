"""PSNR and SSIM against their definitions, and their limits."""

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from lfportrait.metrics import psnr, ssim


def pair(shape, noise=0.1):
    generator = np.random.default_rng(3)
    x = np.linspace(0, 6, shape[1])
    smooth = 0.5 + 0.4 * np.sin(x[None] + np.linspace(0, 3, shape[0])[:, None])
    a = np.broadcast_to(smooth[..., None] if len(shape) == 3 else smooth, shape)
    b = np.clip(a + noise * generator.standard_normal(shape), 0, 1)
    return np.float32(a), np.float32(b)


def plain_ssim(a, b):
    """Wang et al. 2004, Eq. 13: windows of 11 x 11 pixels inside the picture, each channel."""
    offset = np.arange(-5, 6)
    window = np.exp(-(offset[:, None]**2 + offset**2) / (2 * 1.5**2))
    window /= window.sum()

    def mean(values):
        return (sliding_window_view(values, (11, 11), (0, 1)) * window).sum((-2, -1))
    x, y = mean(a), mean(b)
    spread = mean(a * a) - x * x + mean(b * b) - y * y
    together = mean(a * b) - x * y
    return np.mean((2 * x * y + 1e-4) * (2 * together + 9e-4)
                   / ((x * x + y * y + 1e-4) * (spread + 9e-4)))


@pytest.mark.parametrize("shape", [(40, 53), (31, 64, 3), (11, 11, 3)])
@pytest.mark.parametrize("noise", [0.005, 0.2])
def test_metrics_equal_their_definitions(shape, noise):
    a, b = pair(shape, noise)
    a64, b64 = a.astype(np.float64), b.astype(np.float64)
    assert psnr(a, b) == pytest.approx(10 * np.log10(1 / np.mean((a64 - b64)**2)))
    assert ssim(a, b) == pytest.approx(plain_ssim(a64, b64), abs=1e-9)


def test_equal_pictures_are_perfect_and_worse_ones_score_lower():
    a, b = pair((32, 32, 3), 0.02)
    _, c = pair((32, 32, 3), 0.2)
    assert psnr(a, a) == np.inf and ssim(a, a) == pytest.approx(1.0)
    assert psnr(a, b) > psnr(a, c) and ssim(a, b) > ssim(a, c)


def test_a_mask_leaves_out_what_it_does_not_cover():
    a, _ = pair((20, 30, 3))
    b = a + np.float32(0.1)
    b[:, 15:] = 5.0
    left = np.zeros((20, 30), bool)
    left[:, :15] = True
    assert psnr(a, b, left) == pytest.approx(20.0, abs=1e-4)
    assert psnr(a, b) < 0


@pytest.mark.parametrize("function", [psnr, ssim])
def test_shapes_must_agree(function):
    with pytest.raises(ValueError, match="different shape"):
        function(np.zeros((20, 20, 3)), np.zeros((20, 21, 3)))
