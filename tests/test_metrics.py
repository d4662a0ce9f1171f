"""PSNR and SSIM against scikit-image, and their limits."""

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from lfportrait.metrics import psnr, ssim


def pair(shape, noise=0.1):
    generator = np.random.default_rng(3)
    x = np.linspace(0, 6, shape[1])
    smooth = 0.5 + 0.4 * np.sin(x[None] + np.linspace(0, 3, shape[0])[:, None])
    a = np.broadcast_to(smooth[..., None] if len(shape) == 3 else smooth, shape)
    b = np.clip(a + noise * generator.standard_normal(shape), 0, 1)
    return np.float32(a), np.float32(b)


@pytest.mark.parametrize("shape", [(40, 53), (31, 64, 3), (11, 11, 3)])
@pytest.mark.parametrize("noise", [0.005, 0.2])
def test_metrics_equal_scikit_image(shape, noise):
    a, b = pair(shape, noise)
    a64, b64 = a.astype(np.float64), b.astype(np.float64)
    assert psnr(a, b) == pytest.approx(peak_signal_noise_ratio(a64, b64, data_range=1.0))
    expected = structural_similarity(
        a64, b64, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
        channel_axis=2 if len(shape) == 3 else None)
    assert ssim(a, b) == pytest.approx(expected, abs=1e-9)


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
