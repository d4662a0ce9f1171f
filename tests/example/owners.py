"""Owners of an atlas' pixels, at random."""

import numpy as np

from lfportrait.example.patches import settled


def random_owners(seed, shape=(32, 48)):
    """Half of the pixels own themselves, a fifth nobody owns, others own the rest, int32 [H, W]."""
    random = np.random.default_rng(seed)
    size = shape[0] * shape[1]
    owner = np.where(random.random(size) < 0.5, np.arange(size), random.integers(0, size, size))
    owner[random.random(size) < 0.2] = -1
    loose = (owner >= 0) & (owner[owner] < 0)
    owner[loose] = -1
    return settled(owner.reshape(shape).astype(np.int32))
