"""Features lie where they are, and the two rounds find the pairs that show the same."""

import numpy as np
import pytest

from lfportrait.capture.calibration.features import (
    Features,
    camera_stood_still,
    likely_pairs,
    likeness,
    match_features,
    neighbouring_pairs,
    sift_features,
    without_still,
)


def descriptors(seed: int, count: int) -> np.ndarray:
    raw = np.random.default_rng(seed).gamma(0.5, 1.0, (count, 128))
    roots = np.sqrt(raw / raw.sum(1, keepdims=True))
    return np.minimum(512 * roots + 0.5, 255).astype(np.uint8)


@pytest.mark.parametrize("sigma", [2.0, 5.0, 11.0])
def test_a_blob_is_found_at_its_centre(sigma):
    y, x = np.mgrid[:300, :260] + 0.5
    blob = 20 + 200 * np.exp(-((x - 120.3)**2 + (y - 140.6)**2) / (2 * sigma**2))
    found = sift_features(np.repeat(blob[..., None], 3, 2).astype(np.uint8), 1)
    assert np.abs(found.places[0] - (120.3, 140.6)).max() < 0.1


def test_none_where_the_mask_is_zero_or_the_picture_is_flat():
    noise = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    mask = np.zeros((120, 160), np.uint8)
    mask[:, :80] = 255
    places = sift_features(noise, 500, mask).places
    assert len(places) > 20
    assert (places[:, 0] < 81).all()
    flat = sift_features(np.full((120, 160, 3), 90, np.uint8), 500)
    assert flat.places.shape == (0, 2)
    assert len(match_features(flat.descriptors, descriptors(0, 9))) == 0


def test_matches_are_those_of_a_plain_search():
    one, other = descriptors(1, 300), descriptors(2, 260)
    other[:120] = one[50:170]
    other[200] = one[0]
    other[201] = one[0]  # twice the same: no clear nearest
    # Copies with a little noise, as of another photo.
    noise = np.random.default_rng(3).integers(-3, 4, other.shape)
    other = np.clip(other.astype(int) + noise, 0, 255).astype(np.uint8)
    dot = one.astype(np.int64) @ other.T.astype(np.int64)
    apart = 2 - 2 * np.minimum(dot / 512**2, 1)
    expected = []
    for i, row in enumerate(apart):
        order = np.argsort(row)
        if (row[order[0]] < 0.64 * row[order[1]] and row[order[0]] < 0.49
                and apart[:, order[0]].argmin() == i):
            expected.append((i, order[0]))
    found = match_features(one, other)
    assert found.dtype == np.uint32
    assert sorted(map(tuple, found)) == expected
    assert {(50 + k, k) for k in range(120)} <= set(map(tuple, found))
    assert not (found[:, 0] == 0).any()


def walk(count: int) -> list[Features]:
    """Photos along a way: each shares half of its features with the next."""
    world = descriptors(7, 60 * count)
    return [Features(np.zeros((120, 2), np.float32), world[60 * i:60 * i + 120], np.arange(120))
            for i in range(count - 1)]


def test_likely_pairs_are_those_that_overlap():
    found = likely_pairs(likeness(walk(31)))
    assert {(i, i + 1) for i in range(29)} <= set(found)
    assert len(found) < 0.8 * 30 * 29 / 2
    assert found == sorted(found)
    few = likely_pairs(likeness(walk(6)))
    assert few == [(i, j) for i in range(5) for j in range(i + 1, 5)]


def test_neighbouring_pairs():
    found = neighbouring_pairs(40, reach=3)
    assert (5, 8) in found and (5, 9) in found and (5, 10) not in found and (5, 21) in found
    assert all(0 <= i < j < 40 for i, j in found)


def test_what_stands_still_with_the_camera_goes():
    random = np.random.default_rng(0)
    first = random.uniform(0, 500, (40, 2))
    second, third = first + random.uniform(-1, 1, (40, 2)), first + random.uniform(-1, 1, (40, 2))
    second[30:] += 20  # the person
    third[30:] += 35
    features = [Features(places.astype(np.float32), descriptors(0, 40), np.arange(0))
                for places in (first, second, third)]
    same = np.repeat(np.arange(40, dtype=np.uint32)[:, None], 2, 1)
    wrong = np.array([[3, 35]], np.uint32)  # what was still once is behind the person
    matches = {(0, 1): same, (1, 2): same, (0, 2): np.concatenate([same[30:], wrong])}
    assert camera_stood_still(features, matches)
    left = without_still(features, matches)
    assert list(left) == list(matches)
    for own in left.values():
        assert (own == same[30:]).all()
    assert not camera_stood_still(features, left)
    assert not camera_stood_still(features, {})
    assert without_still(features, {(0, 1): same[:0]})[0, 1].shape == (0, 2)
