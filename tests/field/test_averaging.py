"""The mean of a training's last states, also across a checkpoint."""

import numpy as np
import pytest

from lfportrait.field import ReconstructConfig, reconstruct_with_figures
from lfportrait.field.training.lattice import STATES, Average, Lattice
from tests.field.test_field import ball_capture


def lattice(values):
    points = np.zeros((2, 2, 3), bool)
    points[0] = True
    found = Lattice.filled(points, 0.0, 16, np.zeros(3), np.ones(3))
    found.density[:], found.rows[:] = values[0], values[1]
    return found


def states(count, seed=0):
    random = np.random.default_rng(seed)
    return [(random.normal(size=7).astype(np.float32),
             random.normal(size=(7, 16)).astype(np.float32)) for _ in range(count)]


@pytest.mark.parametrize("stopped", [0, 1, 4])
def test_it_is_the_mean_of_the_states_and_leaves_the_optimisers_own_values(stopped):
    seen = states(5)
    average = Average(lattice(seen[0]), 12)
    for number, values in enumerate(seen):
        if number == stopped:  # killed, and taken up again
            average = Average.restored(average.state, lattice(values))
        average.add(lattice(values))
    last = lattice(seen[-1])
    average.put(last)
    assert np.allclose(last.density, np.mean([one for one, _ in seen], axis=0), atol=1e-6)
    assert np.allclose(last.rows[:, :12], np.mean([one for _, one in seen], axis=0)[:, :12],
                       atol=1e-6)
    assert np.array_equal(last.rows[:, 12:], seen[-1][1][:, 12:])


def test_without_a_state_nothing_changes():
    values = states(1)[0]
    found = lattice(values)
    Average(found, 12).put(found)
    assert np.array_equal(found.density, values[0]) and np.array_equal(found.rows, values[1])
    assert Average.restored({}, found) is None
    other = Average(lattice(values), 3).state | {"average_density": np.zeros(3, np.float32)}
    with pytest.raises(ValueError, match="another lattice"):
        Average.restored(other, found)


@pytest.mark.parametrize("steps", [20, 333, 5000])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_states_are_added_evenly_over_the_end_of_the_level(steps, share):
    done = np.linspace(0, 1, steps + 1)
    added = [n for n in range(1, steps + 1) if Average.due(done[n - 1], done[n], share)]
    assert abs(len(added) - min(share * STATES, share * steps)) <= 1
    if added:
        assert done[added[0]] > 1 - share and np.ptp(np.diff(added)) <= 1


def test_a_field_is_nearer_to_held_out_views_for_it():
    capture = ball_capture()
    psnr = {}
    for share in (0.0, 0.3):
        config = ReconstructConfig(resolutions=(24,), rays=(0.3,), polyak_fraction=share)
        psnr[share] = reconstruct_with_figures(capture, config)[1]["test"]["psnr"]
    assert psnr[0.3] > psnr[0.0] + 0.1
