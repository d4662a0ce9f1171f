"""Dilation and pieces of points, against SciPy's; finer lattices, against a plain reference."""

import numpy as np
import pytest
from scipy import ndimage

from lfportrait.field.training.lattice import Lattice, dilated, labelled

CUBE = np.ones((3, 3, 3), bool)
SHAPE = (13, 21, 9)


def points(share, seed=0):
    found = np.random.default_rng(seed).random(SHAPE) < share
    found[:, :, :3] = False  # the box about them is smaller than the lattice
    return found


@pytest.mark.parametrize("share", [0.0, 0.002, 0.03, 0.5, 1.0])
@pytest.mark.parametrize("steps", [1, 2, 4])
def test_dilation_is_that_by_a_cube(share, steps):
    given = points(share)
    assert np.array_equal(dilated(given, steps),
                          ndimage.binary_dilation(given, CUBE, iterations=steps))
    assert np.array_equal(given, points(share))


@pytest.mark.parametrize("share", [0.0, 0.002, 0.03, 0.5, 1.0])
def test_pieces_touch_across_corners(share):
    pieces, count = labelled(points(share))
    expected, many = ndimage.label(points(share), CUBE)
    assert count == many and np.array_equal(pieces, expected)


@pytest.mark.parametrize("shape", [(26, 42, 18), (19, 25, 11), SHAPE])
def test_a_finer_lattice_is_the_mean_of_the_corners(shape):
    random = np.random.default_rng(1)
    there = random.random(SHAPE) < 0.3
    lattice = Lattice.filled(there, 1.0, 16, np.zeros(3), np.ones(3))
    lattice.density[:-1] = random.random(lattice.count, np.float32)
    lattice.rows[:-1] = random.random((lattice.count, 16), np.float32)
    keep = there & (random.random(SHAPE) < 0.2)
    fine = lattice.refined(shape, keep)
    numbers = fine.links[fine.links >= 0]
    assert np.array_equal(numbers, np.arange(fine.count)) and not fine.density[-1]
    assert not fine.rows[-1].any()
    at = (np.indices(shape).reshape(3, -1).T + 0.5) / shape * SHAPE - 0.5
    low = np.clip(np.floor(at).astype(int), 0, np.array(SHAPE) - 2)
    part = np.clip(at - low, 0, 1)
    density, mass, color = np.zeros(len(at)), np.zeros(len(at)), np.zeros((len(at), 16))
    lives = np.zeros(len(at), bool)
    for corner in np.ndindex(2, 2, 2):
        near = tuple((low + corner).T)
        lives |= keep[near]
        weight = np.where(corner, part, 1 - part).prod(axis=1) * there[near]
        density += weight * lattice.density[lattice.links[near]]
        color += weight[:, None] * lattice.rows[lattice.links[near]]
        mass += weight
    found = fine.links.ravel()
    assert np.array_equal(found >= 0, lives)
    found = found[lives]
    assert np.allclose(fine.density[found], density[lives], atol=1e-5)
    color /= np.maximum(mass, 1e-6)[:, None]
    assert np.allclose(fine.rows[found], color[lives], atol=1e-4)
