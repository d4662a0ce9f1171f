"""Tests of rounding to half precision."""

import numpy as np
import pytest

from lfportrait.field.kernels.bricks import floats_of, halves


@pytest.mark.parametrize("shape", [(0,), (5,), (16,), (1000, 27), (3, 16384), (7, 3, 9)])
def test_numbers_are_rounded_as_numpy_rounds_them(shape):
    generator = np.random.default_rng(0)
    values = np.float32(generator.standard_normal(shape) * 10.0 ** generator.uniform(-9, 4, shape))
    found = halves(values)
    assert found.shape == shape
    wanted = np.clip(values, -6e4, 6e4).astype(np.float16)
    assert np.array_equal(found.view(np.uint16), wanted.view(np.uint16))
    assert np.array_equal(floats_of(found), found.astype(np.float32))


def test_edges():
    values = np.float32([0.0, -0.0, 1e9, -1e9, 65504.0, 6e-8, 2.9e-8, 5.97e-8, 1.0 + 2.0 ** -11,
                         1.0 + 3 * 2.0 ** -11, np.inf, -np.inf] * 3)
    wanted = np.clip(values, -6e4, 6e4).astype(np.float16)
    assert np.array_equal(halves(values).view(np.uint16), wanted.view(np.uint16))
    assert np.array_equal(floats_of(wanted), wanted.astype(np.float32))


def test_other_orders_and_types():
    values = np.random.default_rng(1).standard_normal((40, 33))
    assert np.array_equal(halves(values.T), values.T.astype(np.float32).astype(np.float16))
    assert np.array_equal(floats_of(halves(values).T), halves(values).T.astype(np.float32))
