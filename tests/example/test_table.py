"""The look-up table of Eq. 6 against brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.example import TableConfig, build_table
from lfportrait.example.styleblit import integer_costs, quantise
from tests.reference.table import best_cost


def _appearance(seed, height, width):
    """Smooth noise with a rare outlier, like edges on paper."""
    random = np.random.default_rng(seed)
    values = random.normal(0, 0.05, (height, width)).astype(np.float32)
    values[random.integers(height), random.integers(width)] = 0.6
    return values


def _check(appearance, config, unit, cells):
    table = build_table(appearance, config, unit)
    level, low, step = quantise(appearance, config.levels)
    assert (table.low, table.step, table.cell) == (low, step, config.cell)
    position, look = integer_costs(config, unit, step)
    random = np.random.default_rng(0)
    for _ in range(cells):
        query = [int(random.integers(n)) for n in table.indices.shape]
        cost = best_cost(level, config.cell, position, look, config.form,
                         (query[2], query[0], query[1]))
        chosen = int(table.indices[tuple(query)])
        assert cost.ravel()[chosen] == cost.min()


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 25), st.integers(1, 25), st.integers(1, 5),
       st.integers(8, 32), st.sampled_from(["linear", "squared"]), st.floats(1, 30),
       st.floats(0, 4))
def test_no_cell_is_worse_than_brute_force(seed, height, width, cell, levels, form, place, look):
    config = TableConfig(form, place, look, cell, levels)
    _check(_appearance(seed, height, width), config, 3.0, 60)


@pytest.mark.parametrize("form", ["linear", "squared"])
def test_random_cells_of_a_larger_exemplar(form):
    _check(_appearance(7, 120, 90), TableConfig(form), 3.0, 300)


def test_equal_costs_go_to_the_first_pixel():
    """Two alike pixels at equal distance: the earlier one in scan order, in every cell between."""
    appearance = np.zeros((1, 9), np.float32)
    appearance[0, 0] = appearance[0, 8] = 0.5
    config = TableConfig(cell=1, levels=9, position_weight=1.0, appearance_weight=4.0)
    table = build_table(appearance, config, 1.0)
    assert table.indices[0, 4, 8] == 0
    assert table.indices[0, 5, 8] == 8


def test_a_cell_prefers_the_pixel_in_its_middle():
    table = build_table(np.zeros((9, 9), np.float32), TableConfig(cell=3, levels=8), 3.0)
    empty = np.rint(0 - table.low) / table.step
    assert table.indices[1, 1, round(-table.low / table.step)] == 4 * 9 + 4
    assert np.isfinite(empty)


def test_without_appearance_the_place_decides():
    appearance = _appearance(3, 30, 30)
    table = build_table(appearance, TableConfig(appearance_weight=0.0, cell=1, levels=8), 3.0)
    expected = np.arange(900).reshape(30, 30)
    assert (table.indices == expected[..., None]).all()
