"""What is shown behind a head on a panel: a painted plane, and where the light comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..arrays import Float32, Float64, UInt8

__all__ = ["SOLID", "Backdrop", "head_points"]

SOLID = 10.0
"""Density from which a voxel stops light within about a twentieth of a head."""


class _Solid(Protocol):
    """What is asked of a field; see `VoxelField`."""

    density: Float32

    def lattice_points(self) -> Float64:
        """See `VoxelField`."""


@dataclass(frozen=True)
class Backdrop:
    """The painted ground of a stylised field.

    Attributes
    ----------
    picture
        uint8 [h, w, 3], sRGB; its middle lies behind the middle of the eyes, and beyond its borders
        its mirror image goes on.
    pixels
        Its pixels per world unit.
    light
        float64 [3], direction to the light in the portrait frame; z is above 0.
    points
        float32 [P, 3], places of the head in the world: what throws a shadow (`head_points`).
    """

    picture: UInt8
    pixels: float
    light: Float64
    points: Float32

    def __post_init__(self) -> None:
        if self.picture.ndim != 3 or self.picture.shape[2] != 3 or min(self.picture.shape) < 2 or (
                self.picture.dtype != np.uint8):
            raise ValueError(f"a backdrop needs a picture uint8 [h, w, 3], not "
                             f"{self.picture.dtype} {list(self.picture.shape)}")
        if not (np.isfinite(self.pixels) and self.pixels > 0 and self.light.shape == (3,)
                and np.isfinite(self.light).all() and self.light[2] > 0):
            raise ValueError("a backdrop needs pixels per world unit, and light from the front")
        if self.points.ndim != 2 or self.points.shape[1] != 3 or len(self.points) == 0 or (
                not np.isfinite(self.points).all()):
            raise ValueError("a backdrop needs places of the head, [P, 3]")

    @property
    def color(self) -> Float64:
        """Its mean color, float64 [3] in [0, 1]."""
        return np.asarray(self.picture.mean(axis=(0, 1)) / 255.0, np.float64)


def head_points(field: _Solid, most: int = 8192) -> Float32:
    """Places of the field's solid voxels, float32 [P, 3] in the world, at most so many.

    Their choice is random, but always the same.
    """
    solid = np.flatnonzero(field.density > SOLID)
    if not len(solid):
        solid = np.arange(len(field.density))
    if len(solid) > most:
        rng = np.random.Generator(np.random.Philox(key=[45, most]))
        solid = np.sort(rng.choice(solid, most, replace=False))
    points = field.lattice_points()[solid]
    return np.asarray(points if len(points) else np.zeros((1, 3)), np.float32)
