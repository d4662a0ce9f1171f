"""Tests of the rough check of a pair's matches."""

import numpy as np
import pytest

from lfportrait.capture.calibration.database import _rough_inliers


def seen(generator, count):
    """Places of points in two photos of 600 x 400 pixels, two times float32 [count, 2]."""
    points = generator.uniform((-1, -1, 3), (1, 1, 5), (count, 3))
    turned = points @ np.array([[0.98, 0, 0.199], [0, 1, 0], [-0.199, 0, 0.98]]) + (0.6, 0.1, 0)
    return [np.float32(500 * side[:, :2] / side[:, 2:] + (300, 200)) for side in (points, turned)]


def test_right_matches_stay_and_wrong_ones_go():
    generator = np.random.default_rng(0)
    one, other = seen(generator, 120)
    other[80:] = generator.uniform((0, 0), (600, 400), (40, 2))
    inside = _rough_inliers(one, other)
    assert inside[:80].mean() > 0.95
    assert inside[80:].mean() < 0.4
    assert np.array_equal(inside, _rough_inliers(one, other))


@pytest.mark.parametrize("count", [15, 40])
def test_places_that_determine_nothing_are_no_error(count):
    still = np.zeros((count, 2), np.float32)
    line = np.float32(np.stack([np.arange(count), 2 * np.arange(count)], 1))
    for one, other in ((still, still), (line, line), (still, line)):
        assert _rough_inliers(one, other).shape == (count,)
