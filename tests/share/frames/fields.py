"""A field whose views are told apart: a small bright ball before a wide dark wall."""

import numpy as np

from lfportrait.field import VoxelField

C0 = 0.28209479177387814


def marked_field(size=32, near=0.7):
    """A red ball in front (z = near) on the axis, and a blue wall at z = 0, both opaque."""
    axis = 2 * (np.arange(size) + 0.5) / size - 1
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    ball = x ** 2 + y ** 2 + (z - near) ** 2 < 0.2 ** 2
    wall = (np.abs(z) < 0.08) & (np.abs(x) < 0.8) & (np.abs(y) < 0.8)
    filled = ball | wall
    links = np.full(filled.shape, -1, np.int32)
    links[filled] = np.arange(filled.sum(), dtype=np.int32)
    color = np.where(ball[filled][:, None], (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    sh = ((color - 0.5) / C0)[:, :, None].astype(np.float32)
    return VoxelField(links, np.full(len(color), 200.0, np.float32), sh)


def ball_x(picture):
    """Where the red ball is, as a share of the picture's width from its middle, -0.5 to 0.5."""
    picture = picture.astype(int)
    red = (picture[..., 0] > 128) & (picture[..., 2] < 100)
    assert red.any()
    return np.nonzero(red)[1].mean() / picture.shape[1] - 0.5
