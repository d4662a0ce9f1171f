"""Which pairs of photos are compared in full."""

import numpy as np
import pytest

from lfportrait.capture.calibration.features import Features, likely_pairs


def seen(rng, shared, count, own):
    """Photos of one wall: features that all share, and some of their own."""
    def described(size):
        raw = rng.random((size, 128)) ** 4
        return np.uint8(np.minimum(512 * np.sqrt(raw / raw.sum(1, keepdims=True)) + 0.5, 255))

    common = described(shared)
    return [Features(np.zeros((shared + own, 2), np.float32),
                     np.concatenate([common, described(own)]), np.arange(shared + own))
            for _ in range(count)]


@pytest.mark.parametrize("shared, all_of_them", [(40, True), (160, False)])
def test_a_part_of_the_pairs_is_enough_where_matches_are_plenty(shared, all_of_them):
    count = 48
    pairs = likely_pairs(seen(np.random.default_rng(0), shared, count, 20))
    every = count * (count - 1) // 2
    assert (len(pairs) == every) is all_of_them
    # Each photo keeps its best pairs, others of all kinds, and those beside it.
    for photo in range(count):
        assert sum(photo in pair for pair in pairs) >= 20
    assert {(i, i + 1) for i in range(count - 1)} <= set(pairs)
