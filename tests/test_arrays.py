"""The box about a mask."""

import numpy as np
import pytest

from lfportrait.arrays import box_about


@pytest.mark.parametrize("shape", [(9,), (7, 8), (5, 6, 7)])
def test_all_that_is_true_lies_in_the_box_and_touches_its_sides(shape):
    mask = np.random.default_rng(0).random(shape) > 0.9
    mask[tuple(side // 2 for side in shape)] = True
    box = box_about(mask)
    assert [(side.start, side.stop) for side in box] == [
        (along.min(), along.max() + 1) for along in np.nonzero(mask)]
    wide = box_about(mask, 2)
    assert [(side.start, side.stop) for side in wide] == [
        (max(along.min() - 2, 0), min(along.max() + 3, size))
        for along, size in zip(np.nonzero(mask), shape)]


def test_there_is_none_about_nothing():
    assert box_about(np.zeros((3, 4), bool)) is None
