"""Training steps on a GPU against the CPU's, on random fields."""

import numpy as np
import pytest

from lfportrait.field.training.gpu_stepping import (
    GpuSteps,
    cameras_given,
    fits_gpu,
    largest_on_gpu,
    level_given,
    ray_numbers,
    tiles_given,
)
from lfportrait.field.training.stepping import Caster

from .scene import (
    SmallSteps,
    Views,
    on_cpu,
    random_lattice,
    random_spheres,
    step_options,
    taken_steps,
)


@pytest.fixture
def process(gpu_child):
    return gpu_child


@pytest.mark.slow  # shaders; steps by them: below
@pytest.mark.parametrize("basis, density", [(9, 25.0), (4, 25.0), (1, 1.5)])
def test_slopes_equal_the_cpus(process, basis, density):
    lattice, data = random_lattice(basis, density=density), Views().pixels
    random = np.random.default_rng(1)
    tiles = data.tiles[np.sort(random.permutation(len(data.tiles))[:40])]
    greys = random.random(len(tiles)).astype(np.float32)
    scale = (1 / (255 * random.uniform(0.8, 1.2, (5, 3)))).astype(np.float32)
    options = step_options(lattice)
    caster = Caster(lattice, data, basis, 2)
    ground = np.repeat(np.repeat(greys[:, None], 3, axis=1), 16, axis=0)
    caster.cast(tiles, ground, scale, options)
    wanted = np.zeros((lattice.count + 1, 5))
    for writer, owner in np.ndindex(2, 2):
        count = caster.records.counts[writer, owner]
        np.add.at(wanted, caster.records.keys[writer, owner, :count, 0],
                  caster.records.values[writer, owner, :count])
    geometry = lattice.geometry()
    given = {**level_given(lattice, geometry, cameras_given(data, geometry[2], scale), 0.5),
             "rows": lattice.rows, "neighbours": lattice.neighbours(), "basis": basis,
             "tiles": len(tiles), "run": 10}
    records, values, errors = process.call("tests.field.gpu.training.scene:gradients", given,
                                           ray_numbers(options), tiles_given(data, tiles, greys))
    found = np.zeros_like(wanted)
    np.add.at(found, records[:, 0], values)
    assert (np.abs(found - wanted).max(axis=0) < 1e-4 * np.abs(wanted).max(axis=0)).all()
    assert (np.abs(wanted).max(axis=0) > 1e-6).all()
    assert np.allclose(errors, caster.errors, rtol=1e-4, atol=1e-5)
    # One record for each point of a block.
    assert len(np.unique(records[:, [0, 2]], axis=0)) == len(records) > 1000


def on_gpu(process, kind=GpuSteps):
    """A function that makes steps on a GPU."""
    return lambda behind, level: kind(process, level, tiles=24, behind=behind)


@pytest.mark.slow  # shaders; by the CPU: tests/field
@pytest.mark.parametrize("basis, kind, more", [
    (9, GpuSteps, {}), (4, GpuSteps, {}),
    # Notes that find no room and are begun again, colors in several pages.
    (9, SmallSteps, {}), (9, SmallSteps, {"lambda_tv_sh": 0.02})])
def test_steps_equal_the_cpus(process, basis, kind, more):
    values = {"lambda_tv": 0.02, "polyak_fraction": 1.0, **more}
    wanted, wanted_errors, wanted_sums, wanted_table, _ = taken_steps(on_cpu, basis, **values)
    found, errors, sums, table, _ = taken_steps(on_gpu(process, kind), basis, **values)
    assert len(errors) == len(wanted_errors) == 5
    for (own, total), (other, other_total) in zip(errors, wanted_errors, strict=True):
        assert np.allclose(own, other, rtol=1e-3, atol=1e-4)
        assert np.isclose(total, other_total, rtol=1e-4)
    assert np.array_equal(table, wanted_table)
    begun = random_lattice(basis)
    moved = np.abs(wanted.density - begun.density)
    assert np.quantile(moved, 0.3) > 1e-3  # by rays, or by total variation
    assert np.allclose(found.density, wanted.density, atol=1e-4 * moved.max())
    columns = 3 * basis
    change = np.abs(wanted.rows - begun.rows)[:, :columns].max()
    assert change > 0.1
    assert np.allclose(found.rows[:, :columns], wanted.rows[:, :columns], atol=1e-4 * change)
    assert np.allclose(found.rows[:, -2], wanted.rows[:, -2], atol=1e-4)
    assert np.allclose(found.rows[:, -1], wanted.rows[:, -1], rtol=1e-3, atol=1e-14)
    assert sums.count == wanted_sums.count == 2
    assert np.allclose(sums.density, wanted_sums.density, atol=1e-3)
    assert np.allclose(sums.rows, wanted_sums.rows, atol=1e-3)


@pytest.mark.slow  # shaders
def test_total_variation_is_taken_up(process):
    # What the steps above would not show, were it left out on both sides.
    once = taken_steps(on_gpu(process), 4, lambda_tv=0.02, lambda_tv_sh=0.02)[0]
    without = taken_steps(on_gpu(process), 4, lambda_tv=0.0)[0]
    assert (np.abs(once.density - without.density) > 1e-3).mean() > 0.2
    assert (np.abs(once.rows - without.rows)[:, :12].max(axis=1) > 1e-4).mean() > 0.2


@pytest.mark.slow  # shaders
def test_spheres_behind_the_lattice_equal_the_cpus(process):
    wanted, wanted_errors, *_, spheres = taken_steps(on_cpu, 4, room=True)
    found, errors, *_, own_spheres = taken_steps(on_gpu(process), 4, room=True)
    for (own, _), (other, _) in zip(errors, wanted_errors, strict=True):
        assert np.allclose(own, other, rtol=3e-3, atol=1e-3)
    begun = random_spheres(Views().pixels, wanted).background.data
    moved = np.abs(spheres.background.data - begun)
    assert (moved > 1e-3).mean() > 0.3
    # Slopes of a few 2^-33 are rounded: places that hardly count may go another way.
    off = np.abs(own_spheres.background.data - spheres.background.data)
    for part in (np.s_[..., :3], np.s_[..., 3]):
        taken = moved[part] > 0
        assert (np.quantile(off[part][taken], 0.98)
                < 0.01 * np.quantile(moved[part][taken], 0.9))
    assert np.isclose(own_spheres.mean_square, spheres.mean_square, rtol=1e-3).mean() > 0.99
    assert np.allclose(found.density, wanted.density, atol=0.02)


@pytest.mark.slow  # shaders
def test_steps_give_the_same_bytes_again(process):
    once, again = (taken_steps(on_gpu(process), 4, room=True) for _ in range(2))
    assert np.array_equal(once[0].density, again[0].density)
    assert np.array_equal(once[0].rows, again[0].rows)
    assert np.array_equal(once[4].background.data, again[4].background.data)


@pytest.mark.slow  # shaders
def test_largest_weights_equal_the_cpus(process):
    lattice, data = random_lattice(1), Views().pixels
    options = step_options(lattice)
    scale = np.full((5, 3), 1 / 255, np.float32)
    wanted = Caster(lattice, data, 1, 2).largest(data.tiles, scale, options)
    found = largest_on_gpu(process, lattice, data, data.tiles, scale, options)
    assert found.shape == wanted.shape
    assert np.allclose(found, wanted, atol=1e-4)
    assert (wanted > 0.3).sum() > 20


def test_what_the_shaders_cannot_do_stays_on_the_cpu():
    lattice = random_lattice(1)
    assert fits_gpu(lattice)
    lattice.links = np.full((2, 2, 1024), -1, np.int32)
    assert not fits_gpu(lattice)
