"""Repeats: constructed pictures with known answers, and sums written out lag by lag."""

import time

import numpy as np
import pytest
from scipy import ndimage

from lfportrait_eval.metrics import strongest_repeat
from lfportrait_eval.metrics.repeats import LEAST_PEAK, luma, masked_autocorrelation, over_exemplar

UNIT = 80.0
WHOLE = np.ones((240, 280), bool)


def strokes(seed=0, shape=WHOLE.shape, breadth=3.0, contrast=0.1) -> np.ndarray:
    """Independent strokes of one breadth, float32 [H, W]."""
    noise = ndimage.gaussian_filter(np.random.default_rng(seed).standard_normal(shape), breadth)
    return np.float32(0.5 + contrast * noise / noise.std())


def repeats(picture: np.ndarray, mask: np.ndarray, unit: float) -> float:
    """How much a region repeats itself: the highest peak."""
    return strongest_repeat(picture, mask, unit).peak


def grey(plane: np.ndarray) -> np.ndarray:
    return np.repeat(plane[..., None], 3, axis=2)


def tiled(height=40, width=35) -> np.ndarray:
    return np.tile(strokes(1)[:height, :width], (10, 14))[:240, :280]


def shapes() -> dict[str, np.ndarray]:
    down, right = np.mgrid[:240, :280]
    ring = np.hypot(down - 120, right - 140)
    return {"whole": WHOLE, "disc": ring < 110, "ring": (ring < 115) & (ring > 60),
            "triangle": down > right, "two parts": (right < 110) | (right > 170)}


def test_independent_strokes_repeat_by_chance_alone():
    for breadth in (1.0, 3.0, 5.0):
        found = [strongest_repeat(grey(strokes(seed, breadth=breadth)), WHOLE, UNIT)
                 for seed in range(4)]
        assert max(one.peak for one in found) < 0.3
        # The formula of chance holds: what is found is about as high.
        assert np.mean([one.peak for one in found]) == pytest.approx(
            np.mean([one.chance for one in found]), rel=0.35)


@pytest.mark.parametrize("size", [(24, 20), (40, 35), (60, 100)])
def test_rows_of_tiles_are_found_at_their_distance(size):
    found = strongest_repeat(grey(tiled(*size)), WHOLE, UNIT)
    assert found.peak > 0.9
    down, right = found.lag
    assert down % size[0] == 0 and right % size[1] == 0


@pytest.mark.parametrize("shape", shapes())
def test_the_shape_of_the_region_does_not_matter(shape):
    mask = shapes()[shape]
    # What is outside is neither shown nor counted.
    outside = np.where(mask, tiled(), np.float32(0.9))
    assert repeats(grey(outside), mask, UNIT) == repeats(grey(np.where(
        mask, tiled(), np.float32(0.1))), mask, UNIT)
    assert repeats(grey(outside), mask, UNIT) > 0.9
    assert repeats(grey(np.where(mask, strokes(2), np.float32(0.9))), mask, UNIT) < 0.35


def test_a_large_piece_that_is_shown_twice_is_found():
    plane = strokes(3)
    plane[120:230, 150:270] = plane[5:115, 10:130]
    found = strongest_repeat(grey(plane), WHOLE, UNIT)
    assert found.lag in ((115, 140), (-115, -140))
    # The share of the copy in what overlaps.
    assert found.peak == pytest.approx(110 * 120 / (125 * 140), abs=0.15)
    assert found.peak > 2 * found.chance


def test_parallel_hair_is_no_repeat_unless_its_hairs_stand_at_equal_distances():
    across = np.mgrid[:240, :280].sum(axis=0) / np.sqrt(2)
    lines = strokes(5, (1, 800), breadth=2.0)[0]
    loose = np.interp(2 * across, np.arange(800), lines) + 0.3 * (strokes(6) - 0.5)
    assert repeats(grey(np.float32(loose)), WHOLE, UNIT) < 0.4
    combed = 0.5 + 0.1 * np.sin(2 * np.pi * across / 16)
    assert repeats(grey(np.float32(combed)), WHOLE, UNIT) > 0.9


def test_shading_does_not_count():
    down, right = np.mgrid[:240, :280]
    column = 0.25 * np.cos(np.pi * (right / 280 - 0.5)) - 0.2 * down / 240
    plain = repeats(grey(strokes(7)), WHOLE, UNIT)
    assert repeats(grey(np.float32(strokes(7) + column)), WHOLE, UNIT) == pytest.approx(
        plain, abs=0.05)


def test_bytes_scale_and_contrast_change_nothing():
    picture = grey(tiled())
    value = repeats(picture, WHOLE, UNIT)
    assert repeats(np.uint8(picture * 255 + 0.5), WHOLE, UNIT) == pytest.approx(value, abs=0.01)
    assert repeats(0.3 + 0.5 * picture, WHOLE, UNIT) == pytest.approx(value, abs=0.05)
    twice = picture.repeat(2, axis=0).repeat(2, axis=1)
    assert repeats(twice, np.ones(twice.shape[:2], bool), 2 * UNIT) == pytest.approx(
        value, abs=0.02)


def test_what_can_not_be_seen_does_not_repeat():
    assert repeats(np.full((*WHOLE.shape, 3), 0.4), WHOLE, UNIT) < 1e-3
    faint = np.float32(0.5 + 0.005 * (tiled() - 0.5))
    assert repeats(grey(faint), WHOLE, UNIT) < 0.1


def test_nothing_and_nonsense():
    picture = grey(strokes())
    assert np.isnan(repeats(picture, ~WHOLE, UNIT))
    whole, none = (strongest_repeat(picture, mask, UNIT) for mask in (WHOLE, ~WHOLE))
    assert np.isnan(over_exemplar(whole, none)) and np.isnan(over_exemplar(none, whole))
    dot = np.zeros_like(WHOLE)
    dot[7, 9] = True
    assert repeats(picture, dot, UNIT) == 0
    for wrong in ({"unit": 0.0}, {"unit": -1.0}):
        with pytest.raises(ValueError, match="must be"):
            strongest_repeat(picture, WHOLE, **wrong)
    with pytest.raises(ValueError, match="mask of its size"):
        repeats(picture, WHOLE[:-1], UNIT)


def test_the_ratio_is_over_the_exemplar_and_what_chance_gives():
    strokes_8 = grey(strokes(8))
    exemplar, copied, plain = (strongest_repeat(picture, WHOLE, UNIT) for picture in (
        strokes_8, grey(tiled()), np.full_like(strokes_8, 0.5)))
    assert over_exemplar(copied, exemplar) > 3
    assert over_exemplar(copied, copied) == pytest.approx(1)
    assert over_exemplar(exemplar, plain) < 1.5
    assert over_exemplar(copied, plain) <= 1 / LEAST_PEAK


def test_every_lag_is_the_plain_coefficient():
    generator = np.random.default_rng(9)
    values, mask = generator.random((13, 11)), generator.random((13, 11)) < 0.7
    least = 0.05
    found, common = masked_autocorrelation(values, mask, least=least)
    assert found.shape == common.shape == (25, 21)
    for down in range(-12, 13):
        for right in range(-10, 11):
            pairs = [(values[y, x], values[y + down, x + right])
                     for y in range(max(0, -down), min(13, 13 - down))
                     for x in range(max(0, -right), min(11, 11 - right))
                     if mask[y, x] and mask[y + down, x + right]]
            assert common[down + 12, right + 10] == len(pairs)
            if len(pairs) < 2:
                assert found[down + 12, right + 10] == 0
                continue
            first, second = np.array(pairs).T
            wanted = np.mean((first - first.mean()) * (second - second.mean())) / np.sqrt(
                (first.var() + least ** 2) * (second.var() + least ** 2))
            assert found[down + 12, right + 10] == pytest.approx(wanted, abs=2e-4)
    assert found[12, 10] == found.max()


def test_luma_of_bytes_and_floats():
    picture = np.random.default_rng(0).integers(0, 256, (4, 5, 3), dtype=np.uint8)
    assert luma(picture) == pytest.approx(luma(picture / 255), abs=1e-6)
    assert luma(np.ones((1, 1, 3))) == pytest.approx(1.0)


def test_a_large_picture_takes_no_time():
    picture, mask = grey(strokes(0, (768, 768))), np.ones((768, 768), bool)
    start = time.process_time()
    repeats(picture, mask, 110.0)
    assert time.process_time() - start < 3.0  # half a second on an idle core
