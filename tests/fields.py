"""Small fields for tests."""

import numpy as np

from lfportrait.field import VoxelField


def shell_field(size=24, basis=9, seed=0, density=25.0, box=(1.0, 1.0, 1.0), center=(0, 0, 0),
                shape=None):
    """An uneven shell with random colours; values are exact in float16."""
    random = np.random.default_rng(seed)
    shape = shape or (size, size, size)
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    radius = np.sqrt(x * x + 0.8 * y * y + z * z)
    filled = np.abs(radius - 0.55 - 0.1 * np.sin(5 * x)) < 0.2
    count = int(filled.sum())
    links = np.full(shape, -1, np.int32)
    links[filled] = random.permutation(count).astype(np.int32)
    values = (density * random.random(count)).astype(np.float16).astype(np.float32)
    sh = (0.4 * random.standard_normal((count, 3, basis))).astype(np.float16).astype(np.float32)
    return VoxelField(links, values, sh, np.asarray(center, float), np.asarray(box, float))
