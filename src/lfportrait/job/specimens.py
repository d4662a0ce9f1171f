"""Minimal inputs of each stage, to compile its kernels.

A grey ball with a face's landmarks is photographed by hand from a few sides, in a few pixels; a few
colored squares with the same landmarks are its painting. Nobody looks at what comes out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..capture import Camera, Capture
from ..example import Exemplar
from ..field import VoxelField

__all__ = ["ball_capture", "ball_field", "ball_points", "drawn_exemplar"]

_RADIUS = 0.6


def _face() -> NDArray[np.float64]:
    """68 landmarks of a frontal face, [68, 2]: x right, y down, the face about 2 high."""
    def arc(count: int, x: float, y: float, rx: float, ry: float, start: float, end: float,
            ) -> NDArray[np.float64]:
        angle = np.radians(np.linspace(start, end, count))
        return np.stack([x + rx * np.cos(angle), y + ry * np.sin(angle)], axis=1)

    def line(count: int, x0: float, y0: float, x1: float, y1: float) -> NDArray[np.float64]:
        return np.stack([np.linspace(x0, x1, count), np.linspace(y0, y1, count)], axis=1)

    eyes = [arc(7, side * 0.28, -0.17, 0.11, 0.05, 180, 540)[:6] for side in (-1, 1)]
    return np.concatenate([
        arc(17, 0, -0.15, 0.62, 1.0, 175, 5), line(5, -0.47, -0.32, -0.12, -0.35),
        line(5, 0.12, -0.35, 0.47, -0.32), line(4, 0, -0.18, 0, 0.15),
        line(5, -0.13, 0.21, 0.13, 0.22), *eyes, arc(13, 0, 0.47, 0.24, 0.1, 180, 540)[:12],
        arc(9, 0, 0.47, 0.17, 0.03, 180, 540)[:8]])


def ball_points(cameras: Camera, view: int) -> NDArray[np.float64]:
    """Where each pixel's ray meets the ball: float64 [H, W, 3], NaN where it does not."""
    origins, directions = cameras.rays(view)
    half = (origins * directions).sum(-1)
    root = half ** 2 - (origins ** 2).sum(-1) + _RADIUS ** 2
    along = np.where(root > 0, -half - np.sqrt(np.maximum(root, 0)), np.nan)
    points = origins + along[:, None] * directions
    return points.reshape(int(cameras.height[view]), int(cameras.width[view]), 3)


def ball_capture(size: int = 32, views: int = 16, cut_out: bool = True,
                 arc: float = 115.0) -> Capture:
    """Photos of a speckled ball with landmarks on its front.

    Parameters
    ----------
    size
        Width and height of the photos in pixels.
    views
        Number of photos on an arc.
    cut_out
        Whether the photos have mattes.
    arc
        Half of the arc in degrees.
    """
    cameras = Camera.arc(np.linspace(-arc, arc, views), distance=4.0, width=size, height=size,
                         focal=1.7 * size)
    images, alphas = [], []
    for view in range(views):
        points = ball_points(cameras, view)
        speckles = 130 + 60 * np.sin(7 * points @ np.array([1.0, 1.7, 0.6]))
        images.append(np.repeat(np.nan_to_num(speckles, nan=20.0)[..., None], 3, 2
                                ).astype(np.uint8))
        alphas.append(np.where(np.isfinite(speckles), 255, 0).astype(np.uint8))
    face = _face()
    x, y = 1.5 * _RADIUS * face[:, 0], -0.7 * _RADIUS * (face[:, 1] + 0.3)
    z = np.sqrt(np.maximum(_RADIUS ** 2 - x ** 2 - y ** 2, 0.0))
    return Capture(cameras, images, alphas if cut_out else None,
                   [f"{view}.png" for view in range(views)], np.zeros(views, bool),
                   landmarks=np.stack([x, y, z], axis=1))


def ball_field(basis: int, size: int = 20) -> VoxelField:
    """The ball as a field with ``basis`` coefficients a channel."""
    axis = 2.0 * (np.arange(size) + 0.5) / size - 1.0
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    filled = np.abs(np.sqrt(x * x + y * y + z * z) - _RADIUS) < 3.0 / size
    links = np.full((size, size, size), -1, np.int32)
    links[filled] = np.arange(filled.sum(), dtype=np.int32)
    count = int(filled.sum())
    return VoxelField(links, np.full(count, 60.0, np.float32),
                      np.zeros((count, 3, basis), np.float32))


def drawn_exemplar(width: int = 96, height: int = 128) -> Exemplar:
    """A few colored shapes with a face's landmarks."""
    scale, middle = 0.3 * width, np.array([0.5 * width, 0.5 * height])
    x, y = np.meshgrid((np.arange(width) + 0.5 - middle[0]) / scale,
                       (np.arange(height) + 0.5 - middle[1]) / scale)
    head = np.hypot(x / 0.8, y / 1.1) < 1
    face = np.hypot(x / 0.6, (y - 0.1) / 0.85) < 1
    body = (np.abs(x) < 0.4 + 2 * np.clip(y - 1, 0, 9)) & (y > 0.4)
    image = np.full((height, width, 3), (90, 130, 170), np.uint8)
    for where, color in ((body, (160, 60, 50)), (head, (60, 40, 30)), (face, (225, 180, 150))):
        image[where] = color
    image += np.random.default_rng(0).integers(0, 20, image.shape, np.uint8)
    return Exemplar(image, _face() * scale + middle, "drawn", (head | body).astype(np.float32))
