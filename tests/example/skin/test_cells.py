"""What holds for a neighbourhood of the unwrapped head."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import grey_closing, grey_opening

from lfportrait.example.painter.light import Cells


@pytest.fixture
def flat():
    return np.random.default_rng(2).uniform((-2, -1), (2, 1), (40000, 2)).astype(np.float32)


def test_what_is_carried_begins_as_it_is_and_fades(flat):
    inside = flat[:, 0] < 0
    values = np.where(flat[:, 1] < 0, 0.3, -0.2).astype(np.float32)
    values[~inside] = 99  # nobody asks
    cells = Cells.over(flat, 0.05)
    carried = cells.extrapolated(values, inside, 1.0, 10.0)
    away, upper, lower = flat[:, 0], flat[:, 1] < -0.3, flat[:, 1] > 0.3
    for part, value in ((upper, 0.3), (lower, -0.2)):
        assert np.allclose(carried[part & (away < -0.2)], value, atol=0.02)
        assert np.allclose(carried[part & (np.abs(away - 0.1) < 0.03)], 0.9 * value, atol=0.04)
        assert np.allclose(carried[part & (np.abs(away - 0.25) < 0.03)], 0.5 * value, atol=0.06)
        assert np.allclose(carried[part & (away > 0.65)], 0, atol=0.01)


def test_nothing_inside_is_carried_nowhere(flat):
    assert not Cells.over(flat, 0.1).extrapolated(flat[:, 0], np.zeros(len(flat), bool), 1, 5).any()


@pytest.mark.parametrize(("name", "whole"), [("closed", grey_closing), ("opened", grey_opening)])
def test_closing_and_opening_are_those_of_a_picture(name, whole):
    # One place a cell, in any order.
    random = np.random.default_rng(3)
    picture = random.uniform(size=(12, 17)).astype(np.float32)
    rows, columns = np.indices(picture.shape).reshape(2, -1)
    order = random.permutation(picture.size)
    flat = 0.25 * np.stack([columns, rows], axis=1)[order].astype(np.float32) + np.float32(7)
    y, x = np.mgrid[-2:3, -2:3]
    wanted = whole(picture, footprint=np.hypot(y, x) <= 2, mode="nearest")
    found = getattr(Cells.over(flat, 0.25), name)(picture.reshape(-1)[order], 2)
    assert np.allclose(found, wanted.reshape(-1)[order], atol=1e-5)


def test_gaps_are_what_a_closing_adds():
    random = np.random.default_rng(4)
    picture = random.uniform(size=(12, 17)).astype(np.float32)
    rows, columns = np.indices(picture.shape).reshape(2, -1)
    flat = 0.25 * np.stack([columns, rows], axis=1).astype(np.float32)
    y, x = np.mgrid[-2:3, -2:3]
    wanted = grey_closing(picture, footprint=np.hypot(y, x) <= 2, mode="nearest") - picture
    values, known = picture.reshape(-1), np.ones(picture.size, bool)
    cells = Cells.over(flat, 0.25)
    assert np.allclose(cells.gaps(values, known, 2), wanted.reshape(-1), atol=1e-5)
    # What is not known is no gap, and closes none.
    known[random.integers(0, len(known), 60)] = False
    odd = np.where(known, values, random.uniform(-9, 9, len(values)).astype(np.float32))
    assert np.array_equal(cells.gaps(odd, known, 2), cells.gaps(values, known, 2))
    assert not cells.gaps(values, np.zeros_like(known), 2).any()


def test_what_hangs_together_with_a_seed_stays(flat):
    first, second = (np.hypot(flat[:, 0] - x, flat[:, 1]) for x in (-1, 1))
    values = np.maximum(np.clip(1.5 - 2 * first, 0, 1), np.clip(1.5 - 2 * second, 0, 1))
    left = flat[:, 0] < 0
    joined = Cells.over(flat, 0.05).joined(values, first < 0.1)
    assert np.allclose(joined[left & (values > 0.6)], values[left & (values > 0.6)], atol=0.1)
    assert not joined[~left].any()
    # Seeds that lie beside all of it hold nothing.
    assert not Cells.over(flat, 0.05).joined(values, np.abs(flat[:, 0]) < 0.05).any()
