"""Which pairs of photos are compared in full."""

import numpy as np
import pytest

from lfportrait.capture.calibration.features import Features, likely_pairs, likeness, worth_placing


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
    pairs = likely_pairs(likeness(seen(np.random.default_rng(0), shared, count, 20)))
    every = count * (count - 1) // 2
    assert (len(pairs) == every) is all_of_them
    # Each photo keeps its best pairs, others of all kinds, and those beside it.
    for photo in range(count):
        assert sum(photo in pair for pair in pairs) >= 20
    assert {(i, i + 1) for i in range(count - 1)} <= set(pairs)


def along(count, reach):
    """Likeness of photos of a sweep, of which each shares something with so many before and after.
    """
    apart = np.abs(np.arange(count)[:, None] - np.arange(count))
    return np.where(apart > 0, np.maximum(200.0 * (1.0 - apart / reach), 0.0), 0.0).astype(int)


def test_a_dense_sweep_is_thinned_evenly():
    kept = worth_placing(along(120, 60))
    assert 56 <= len(kept) < 90
    assert kept[0] <= 1 and kept[-1] >= 118
    assert np.diff(kept).max() <= 3


@pytest.mark.parametrize("count, reach", [(56, 60), (120, 20)])
def test_few_photos_and_photos_far_apart_are_all_kept(count, reach):
    assert np.array_equal(worth_placing(along(count, reach)), np.arange(count))


def test_a_photo_that_resembles_none_is_kept():
    alike = along(120, 60)
    alike[33], alike[:, 33] = 0, 0
    assert 33 in worth_placing(alike)


def test_likeness_counts_the_features_that_two_photos_share():
    photos = seen(np.random.default_rng(1), 60, 3, 20)
    alike = likeness(photos)
    assert np.array_equal(alike, alike.T) and not alike.diagonal().any()
    assert (alike[~np.eye(3, dtype=bool)] >= 55).all()
    # Some that are alike in few of many features are found by all of them.
    raw = np.concatenate([seen(np.random.default_rng(2), 0, 1, 400)[0].descriptors,
                          photos[0].descriptors])
    mixed = [Features(np.zeros((len(raw), 2), np.float32), raw, np.arange(len(raw))), photos[0]]
    assert likeness(mixed)[0, 1] >= 14
