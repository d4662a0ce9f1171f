"""Tests of plates on a chart."""

import numpy as np
import pytest

from lfportrait.field.geometry.chart import _operators, fitted_plate


@pytest.mark.parametrize("shape", [(1, 3), (3, 5), (64, 9), (9, 14), (31, 40)])
def test_a_plate_is_what_its_equations_say(shape):
    generator = np.random.default_rng(0)
    values, weights = generator.random(shape), generator.random(shape)
    weights[generator.random(shape) < 0.5] = 0.0
    bend, first = _operators(shape)
    matrix = (np.diag((weights + 0.1).ravel()) + 0.5 * (bend.T @ bend).toarray()
              + 0.2 * (first.T @ first).toarray())
    expected = np.linalg.solve(matrix, (weights * values).ravel()).reshape(shape)
    assert np.allclose(fitted_plate(values, weights, 0.5, 0.2, 0.1), expected, atol=1e-5)
