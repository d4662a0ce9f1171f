"""Rims are followed as a plain dynamic program would."""

import numpy as np
import pytest

from lfportrait.face.rims import STIFF, ways


def plain(gain):
    """The way with the most gain through one table, row by row and column by column."""
    rows, width = gain.shape
    total, came = gain.copy(), np.zeros(gain.shape, int)
    for row in range(1, rows):
        for column in range(width):
            best = total[row - 1, column]
            for step in (-1, 1):
                if 0 <= column + step < width:
                    other = total[row - 1, column + step] - STIFF
                    if other > best:
                        best, came[row, column] = other, step
            total[row, column] += best
    way = [int(total[-1].argmax())]
    for row in range(rows - 1, 0, -1):
        way.append(way[-1] + came[row, way[-1]])
    return way[::-1]


@pytest.mark.parametrize("shape", [(1, 1, 5), (3, 1, 4), (2, 9, 1), (5, 40, 7)])
@pytest.mark.parametrize("steps", [None, 4])
def test_ways_through_several_tables_are_those_through_each(shape, steps):
    gain = np.random.default_rng(3).random(shape)
    if steps:  # equal gains
        gain = np.round(gain * steps) / steps
    np.testing.assert_array_equal(ways(gain), [plain(one) for one in gain])


def test_no_table_has_no_way():
    assert ways(np.zeros((0, 5, 4))).shape == (0, 5)
