"""The embedded capture's head as a field, on which a painting can be tried in seconds."""

from __future__ import annotations

import numpy as np

from ..field import C0, VoxelField
from .shipped import DATA

__all__ = ["HEAD", "demo_head"]

HEAD = DATA / "head.npz"
"""The file of `demo_head`."""


def demo_head() -> VoxelField:
    """The head of the embedded capture as a field of degree 0, made of its exact distances.

    Returns
    -------
    field
        In the portrait frame: a shell of five layers of voxels, the outermost clear.
    """
    with np.load(HEAD, allow_pickle=False) as data:
        side = int(data["side"])
        filled = np.unpackbits(data["filled"], count=side ** 3).reshape(side, side, side) > 0
        density = data["density"] * (np.float32(data["highest"]) / np.float32(255))
        color = data["color"] / 255.0
        radius = np.asarray(data["radius"], np.float64)
    links = np.full(filled.shape, -1, np.int32)
    links[filled] = np.arange(len(density), dtype=np.int32)
    return VoxelField(links, density, ((color - 0.5) / C0)[:, :, None].astype(np.float32),
                      np.zeros(3), radius)
