"""Sharpness against what was painted: known ratios."""

import numpy as np
import pytest
from scipy import ndimage

from lfportrait_eval.metrics import gradient_energy, sharpness

WHOLE = np.ones((60, 70), bool)


def texture(seed=0) -> np.ndarray:
    return np.random.default_rng(seed).random((*WHOLE.shape, 3)).astype(np.float32)


def blurred(picture, sigma):
    return ndimage.gaussian_filter(picture, (sigma, sigma, 0))


def test_a_picture_is_as_sharp_as_itself_and_less_the_more_it_is_blurred():
    picture = texture()
    assert sharpness(picture, picture, WHOLE) == 1
    values = [sharpness(blurred(picture, sigma), picture, WHOLE) for sigma in (0.5, 1, 2, 4)]
    assert 1 > values[0] > values[1] > values[2] > values[3] > 0
    assert sharpness(picture, blurred(picture, 1), WHOLE) == pytest.approx(1 / values[1])
    # Half the contrast is a quarter of the energy; brightness is no matter.
    assert sharpness(0.2 + 0.5 * picture, picture, WHOLE) == pytest.approx(0.25, rel=1e-4)


def test_the_energy_of_a_ramp_is_its_squared_slope():
    down, right = np.mgrid[:60, :70]
    ramp = np.repeat((0.004 * down + 0.003 * right)[..., None], 3, axis=2)
    assert gradient_energy(ramp, WHOLE) == pytest.approx(25e-6, rel=1e-3)
    assert gradient_energy(np.zeros((60, 70, 3)), WHOLE) == 0
    bytes_ = np.uint8(np.repeat(3 * right[..., None], 3, axis=2))
    assert gradient_energy(bytes_, WHOLE) == pytest.approx((3 / 255) ** 2, rel=1e-3)


def test_only_what_is_known_and_inside_counts():
    picture, mask = texture(1), np.zeros_like(WHOLE)
    mask[10:50, 10:60] = True
    # A silhouette beside the mask, and one that the margin takes away.
    rendered = picture.copy()
    rendered[~ndimage.binary_erosion(mask, iterations=3)] = 5.0
    assert sharpness(rendered, picture, mask) == 1
    assert sharpness(rendered, picture, mask, margin=0) > 2
    wanted = picture.copy()
    wanted[20:24, 30:35] = np.nan
    rendered[20:24, 30:35] = 7.0
    assert sharpness(rendered, wanted, mask) == 1
    scattered = np.where(np.random.default_rng(2).random(WHOLE.shape)[..., None] < 0.2, np.nan,
                         picture)
    assert sharpness(blurred(picture, 1), scattered, WHOLE) == pytest.approx(
        sharpness(blurred(picture, 1), picture, WHOLE), rel=0.1)


def test_what_can_not_be_compared_is_nan():
    picture = texture(3)
    assert np.isnan(sharpness(picture, np.full_like(picture, np.nan), WHOLE))
    assert np.isnan(sharpness(picture, np.full_like(picture, 0.5), WHOLE))
    assert np.isnan(gradient_energy(picture, ~WHOLE))
    with pytest.raises(ValueError, match="one size"):
        sharpness(picture, picture[:-1], WHOLE)
    with pytest.raises(ValueError, match="mask of its size"):
        gradient_energy(picture, WHOLE[:-1])
