"""The order of the training rays: every tile its turns, more where the error is large."""

from types import SimpleNamespace

import numpy as np
import pytest

from lfportrait.field.training.pixels import Batches


def tiles(views=3, side=12):
    view, row, column = np.indices((views, side, side)).reshape(3, -1)
    return np.stack([view, 4 * row, 4 * column], 1).astype(np.int32)


def turns(batches, steps, error=None, first=0):
    """How often each tile comes, and the steps' tiles; errors are a function of tiles."""
    data = batches.tiles
    found, all_steps = np.zeros((data.max() + 1,) * 3, int), []
    for number in range(first, first + steps):
        step = batches.step(number)
        all_steps.append(step)
        np.add.at(found, tuple(step.T), 1)
        batches.learn((np.ones(len(step)) if error is None else error(step)).astype(np.float32))
    return found[tuple(data.T)], all_steps


@pytest.mark.parametrize("importance", [0.0, 0.7])
def test_each_tile_comes_once_a_pass_while_errors_are_alike(importance):
    data = SimpleNamespace(tiles=tiles(views=4, side=16))  # 1024 tiles: 8 parts of 128
    batches = Batches(data, 64, 3, 0, importance)
    for number in range(2):
        found, _ = turns(batches, 16, first=16 * number)
        assert (found == 1).all()


def test_tiles_come_in_another_order_with_another_seed():
    data = SimpleNamespace(tiles=tiles())
    orders = [np.concatenate(turns(Batches(data, 20, seed, 0), 5)[1]) for seed in (1, 1, 2)]
    assert np.array_equal(orders[0], orders[1])
    assert not np.array_equal(orders[0], orders[2])


def test_rays_go_where_the_error_is():
    data = SimpleNamespace(tiles=tiles(views=4, side=32))
    bad = (data.tiles[:, 0] == 1) & (data.tiles[:, 1] < 48)

    def error(step):
        return np.where((step[:, 0] == 1) & (step[:, 1] < 48), 4.0, 1.0)

    found, _ = turns(Batches(data, 32, 0, 0, 0.7), 600, error)
    ratio = found[bad].mean() / found[~bad].mean()
    mean = 4 * bad.mean() + 1 - bad.mean()
    wanted = (0.3 + 0.7 * 4 / mean) / (0.3 + 0.7 / mean)
    # What few tiles of a block have shown counts with the mean of all.
    assert 0.7 < ratio / wanted < 1.05
    assert found.min() > 0.5 * found.mean()  # nothing is forgotten
    even, _ = turns(Batches(data, 32, 0, 0, 0.0), 600, error)
    assert even.max() - even.min() <= 1


def test_steps_go_on_from_a_state():
    data = SimpleNamespace(tiles=tiles(views=4, side=16))
    error = np.random.default_rng(0).random((4, 64, 64))

    def of(step):
        return error[tuple(step.T)]

    whole = Batches(data, 24, 5, 1, 0.7)
    _, steps = turns(whole, 40, of)
    first = Batches(data, 24, 5, 1, 0.7)
    turns(first, 17, of)
    state = {name: value.copy() for name, value in first.state.items()}
    second = Batches(data, 24, 5, 1, 0.7)
    second.restore(state)
    _, rest = turns(second, 23, of, first=17)
    assert all(np.array_equal(a, b) for a, b in zip(steps[17:], rest))


def test_a_step_is_never_larger_than_the_tiles():
    batches = Batches(SimpleNamespace(tiles=tiles(views=1, side=3)), 64, 0, 0, 0.7)
    found, steps = turns(batches, 5)
    assert all(len(step) == 9 for step in steps)
    assert (found == 5).all()
