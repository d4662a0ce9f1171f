"""The background of a field: svox2's concentric spheres, for photos of a head in a room."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..arrays import Float32, Float64, Int32
from ..capture import Camera
from .kernels.shells import (
    shells_backward,
    shells_forward,
    shells_mark,
    shells_step,
)

__all__ = ["Background", "cube_rays"]


def cube_rays(cameras: Camera, view: int, center: Float64,
              radius: Float64, pixels: Float64 | None = None,
              ) -> Float32:
    """Rays of a view in the coordinates of a box's cube: float32 [K, 6], origin, unit direction.

    Parameters
    ----------
    center, radius
        float64 [3], the box in the world.
    pixels
        float64 [K, 2], pixel positions (x, y; centres at + 0.5); all pixels in scan order without.
    """
    if pixels is None:
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
    """Layers of spheres about a field's box.

    Attributes
    ----------
    links
        int32 [2 R, R], place of a map pixel (longitude, latitude) in the data, -1 without.
    data
        float32 [N, layers, 4]: red, green, blue, density, near layer first.
    """

    links: Int32
    data: Float32

    @property
    def layers(self) -> int:
        """Number of spheres."""
        return int(self.data.shape[1])

    @staticmethod
    def seen(rays: list[Float32], resolution: int, layers: int,
             density: float) -> Background:
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

    def color(self, rays: Float32, grey: float, stop: float = 1e-3,
              ) -> Float32:
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
