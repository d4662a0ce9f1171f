"""What is behind a head: a room in svox2's concentric spheres, or a painted plane on a panel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import ndimage

from ..arrays import Float32, Float64, Int32, UInt8
from ..capture import Camera
from .kernels.shells import shells_backward, shells_forward, shells_mark, shells_step

SOLID = 10.0  # Density from which a voxel stops light within about a twentieth of a head.


class _Solid(Protocol):
    """What is asked of a field; see `VoxelField`."""

    density: Float32

    def lattice_points(self) -> Float64:
        """See `VoxelField`."""


@dataclass(frozen=True)
class Backdrop:
    """The painted ground of a stylised field."""

    # uint8 [h, w, 3], sRGB; its middle lies behind the middle of the eyes, and beyond its borders
    # its mirror image goes on.
    picture: UInt8
    pixels: float  # Its pixels per world unit.
    light: Float64  # float64 [3], direction to the light in the portrait frame; z is above 0.
    # float32 [P, 3], places of the head in the world: what throws a shadow (`head_points`).
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


def cube_rays(cameras: Camera, view: int, center: Float64, radius: Float64) -> Float32:
    """Rays of a view's pixels in the coordinates of a box's cube: float32 [H W, 6].

    Origin and unit direction each; the box is float64 [3] each in the world.
    """
    width, height = int(cameras.width[view]), int(cameras.height[view])
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = np.stack([x.ravel(), y.ravel()], 1)
    local = np.column_stack([(pixels - cameras.center[view]) / cameras.focal[view],
                             np.ones(len(pixels))])
    directions = local @ cameras.pose[view, :3, :3].T / radius
    rays = np.empty((len(pixels), 6), np.float32)
    rays[:, :3] = (cameras.pose[view, :3, 3] - center) / radius
    rays[:, 3:] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return rays


@dataclass
class Background:
    """Layers of spheres about a field's box."""

    # int32 [2 R, R], place of a map pixel (longitude, latitude) in the data, -1 without.
    links: Int32
    data: Float32  # float32 [N, layers, 4]: red, green, blue, density, near layer first.

    @property
    def layers(self) -> int:
        """Number of spheres."""
        return int(self.data.shape[1])

    @staticmethod
    def seen(rays: list[Float32], resolution: int, layers: int, density: float) -> Background:
        """Grey spheres of ``density`` where any of the rays [K, 6] looks, ``resolution`` rows."""
        marks = np.zeros((2 * resolution, resolution), np.uint8)
        for part in rays:
            shells_mark(part, layers, marks)
        marks = ndimage.binary_dilation(marks)
        links = np.full(marks.shape, -1, np.int32)
        count = int(marks.sum())
        links[marks] = np.arange(count, dtype=np.int32)
        data = np.zeros((count, layers, 4), np.float32)
        data[..., 3] = density
        return Background(links, data)

    def color(self, rays: Float32, grey: float, stop: float = 1e-3) -> Float32:
        """Color of each ray [K, 6] behind the lattice, float32 [K, 3]."""
        found = np.empty((len(rays), 3), np.float32)
        shells_forward(rays, self.links, self.data.reshape(-1, 4), self.layers, grey, stop, found)
        return found

    def upsampled(self) -> Background:
        """The same at twice the map's resolution."""
        double = np.repeat(np.repeat(self.links, 2, axis=0), 2, axis=1)
        there = double >= 0
        links = np.where(there, np.cumsum(there).reshape(there.shape) - 1, -1).astype(np.int32)
        return Background(links, np.ascontiguousarray(self.data[double[there]]))


class BackgroundTrainer:
    """RMSProp on the spheres beside the lattice's own."""

    def __init__(self, background: Background, workers: int, grey: float) -> None:
        self.background, self.grey = background, grey
        shape = (background.data.shape[0] * background.layers, 4)
        self.gradients = np.zeros((workers, *shape), np.float32)
        self.mean_square = np.zeros(shape, np.float32)

    def step(self, rays: Float32, color: Float32,
             slopes: Float32, rate_color: float, rate_density: float) -> None:
        """Descend, given the gradient of the loss [K, 3] with respect to the rays' colors."""
        data = self.background.data.reshape(-1, 4)
        shells_backward(rays, self.background.links, data, self.background.layers, self.grey, 1e-3,
                        color, slopes, self.gradients)
        shells_step(data, self.gradients, self.mean_square, np.float32(rate_color),
                    np.float32(rate_density), np.float32(0.95))
