"""Small fields for tests."""

import numpy as np

from lfportrait.field import VoxelField


def shell_field(size=24, basis=9, seed=0, density=25.0, box=(1.0, 1.0, 1.0), center=(0, 0, 0),
                shape=None):
    """An uneven shell with random colors, here and there below zero; exact in float16."""
    random = np.random.default_rng(seed)
    shape = shape or (size, size, size)
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    radius = np.sqrt(x * x + 0.8 * y * y + z * z)
    filled = np.abs(radius - 0.55 - 0.1 * np.sin(5 * x)) < 0.2
    count = int(filled.sum())
    links = np.full(shape, -1, np.int32)
    links[filled] = random.permutation(count).astype(np.int32)
    values = (density * (1.12 * random.random(count) - 0.12)).astype(np.float16).astype(np.float32)
    sh = (0.4 * random.standard_normal((count, 3, basis))).astype(np.float16).astype(np.float32)
    return VoxelField(links, values, sh, np.asarray(center, float), np.asarray(box, float))


def head_field(size=48, radius=0.6):
    """The solid head of `portraits.ball_head`: a ball, a neck and shoulders, of skin and hair.

    Hair is dark, above the face and behind it; clothes are blue, from well below the chin; all are
    a little striped.
    """
    z, y, x = np.meshgrid(*[2 * (np.arange(size) + 0.5) / size - 1] * 3, indexing="ij")
    ball = np.sqrt(x * x + y * y + z * z) - radius
    body = np.maximum(np.hypot(x, z) - 0.66 * radius - np.maximum(-y - 1.3 * radius, 0),
                      y + 0.5 * radius)
    away = np.minimum(ball, body) * size / 2
    # A clear layer around it, below zero: beyond what is kept there are no colors to mix.
    filled = away < 2
    links = np.full(filled.shape, -1, np.int32)
    links[filled] = np.arange(filled.sum(), dtype=np.int32)
    x, y, z = x[filled], y[filled], z[filled]
    color = np.empty((len(x), 3))
    color[:] = (0.82, 0.62, 0.5)
    color[(y > 0.3 * radius) & (z < y) | (z < -0.2 * radius) & (y > -0.6 * radius)] = (
        0.2, 0.14, 0.1)
    color[y < -1.2 * radius] = (0.2, 0.3, 0.7)
    color += 0.05 * np.sin(14 * (x + y))[:, None]
    sh = ((color - 0.5) / 0.28209479177387814)[:, :, None].astype(np.float32)
    density = (80 * np.clip(0.5 - away[filled], -0.03, 1)).astype(np.float32)
    return VoxelField(links, density, sh)
