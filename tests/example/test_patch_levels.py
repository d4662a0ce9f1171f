"""Levels of the pyramid of guided patch synthesis: how pictures, places and owners become coarser.
"""

import numpy as np
import pytest

from lfportrait.example.kernels.patches import ACTIVE, FIXED, MARGIN, finer_places, level_places
from lfportrait.example.patches import (
    PatchSource,
    at_middles,
    coarser_owner,
    halved,
    middles,
    settled,
)
from tests.example.owners import random_owners


def test_levels_of_the_pyramid_fit_together():
    planes = np.random.default_rng(4).random((7, 6, 2)).astype(np.float32)
    small = halved(planes)
    assert small.shape == (4, 3, 2)
    assert np.allclose(small[1, 2], planes[2:4, 4:6].mean(axis=(0, 1)))
    assert np.allclose(small[3, 0], planes[6, :2].mean(axis=0))
    identity = (np.arange(20)[:, None] * 16 + np.arange(16)).astype(np.int32)
    fine = np.empty((40, 32), np.int32)
    finer_places(identity, 16, np.full(fine.shape, ACTIVE, np.uint8), fine, (40, 32), fine)
    inside = fine[MARGIN:-MARGIN, MARGIN:-MARGIN]
    assert np.array_equal(inside, np.arange(40 * 32).reshape(40, 32)[2:-2, 2:-2])


@pytest.mark.parametrize("step", [1, 2, 4])
def test_places_of_a_level_are_those_of_the_reference(step):
    random = np.random.default_rng(step)
    places = random.uniform(-9, 70, (23, 30, 2)).astype(np.float32)
    places[random.random(places.shape[:2]) < 0.1] = np.nan
    size = 64 // step, 48 // step
    out = np.empty((-(-23 // step), -(-30 // step)), np.int32)
    level_places(places, step, size, out)
    rows, columns = middles(step.bit_length() - 1, out.shape, (23, 30))
    x, y = np.moveaxis(np.nan_to_num(places[rows, columns]) / step, -1, 0).astype(int)
    wanted = (np.clip(y, MARGIN, size[0] - 1 - MARGIN) * size[1]
              + np.clip(x, MARGIN, size[1] - 1 - MARGIN))
    assert np.array_equal(out, wanted)


def test_finer_places_are_those_of_the_reference_and_fixed_ones_those_of_the_start():
    random = np.random.default_rng(2)
    coarse = random.integers(0, 20 * 15, (9, 11)).astype(np.int32)
    state = random.choice([ACTIVE, FIXED], (17, 22)).astype(np.uint8)
    start = random.integers(0, 40 * 29, state.shape).astype(np.int32)
    out = np.empty_like(start)
    finer_places(coarse, 15, state, start, (40, 29), out)
    y, x = np.indices(state.shape)
    v, u = np.divmod(coarse[y // 2, x // 2], 15)
    row = np.clip(2 * v + y % 2, MARGIN, 39 - MARGIN)
    column = np.clip(2 * u + x % 2, MARGIN, 28 - MARGIN)
    assert np.array_equal(out, np.where(state == FIXED, start, row * 29 + column))


def test_a_pyramid_ends_where_no_patch_fits():
    source = PatchSource.of(np.zeros((50, 30, 3), np.float32), np.zeros((50, 30, 4), np.float32))
    assert [picture.shape[:2] for picture in source.pictures] == [(50, 30), (25, 15), (13, 8)]
    assert [planes.shape[:2] for planes in source.guides] == [(50, 30), (25, 15), (13, 8)]


def test_the_middle_of_a_coarse_pixel_lies_in_the_picture():
    rows, columns = np.meshgrid(np.arange(7), np.arange(10), indexing="ij")
    for level, shape in ((0, (7, 10)), (1, (4, 5)), (2, (2, 3))):
        places = middles(level, shape, (7, 10))
        assert np.array_equal(rows[places][:, 0] >> level, np.arange(shape[0]))
        assert np.array_equal(columns[places][0] >> level, np.arange(shape[1]))
        assert np.array_equal(at_middles(rows, level, shape), rows[places])
        assert np.array_equal(at_middles(columns, level, shape), columns[places])


def test_owners_that_have_owners_hand_their_pixels_on():
    owner = np.array([[0, 0, 1, 2], [-1, 6, 5, 4]], np.int32)
    found = settled(owner)
    # Two that own each other, and those of nobody, have no end: each keeps itself.
    assert found.tolist() == [[0, 0, 0, 0], [-1, 5, 6, 7]]
    assert np.array_equal(settled(found), found)


@pytest.mark.parametrize("level", [0, 1, 2])
def test_owners_of_coarser_levels_own_themselves(level):
    owner = random_owners(level)
    shape = 32 >> level, 48 >> level
    coarse = coarser_owner(owner, level, shape)
    flat = coarse.ravel()
    assert coarse.shape == shape and coarse.dtype == np.int32
    assert np.array_equal(flat[flat[flat >= 0]], flat[flat >= 0])
    step = 2 ** level
    middle = owner[step // 2::step, step // 2::step]
    assert np.array_equal(coarse < 0, middle < 0)
    place = (middle // 48 >> level) * shape[1] + (middle % 48 >> level)
    moved = (middle >= 0) & (coarse != place)
    assert moved.sum() < 0.7 * (middle >= 0).sum()
    # Only those change hands whose owner is not its own there.
    before = np.where(middle >= 0, place, -1).ravel()
    assert (before[place[moved]] != place[moved]).all()
