"""Make a field of a modelled head without training, from its distances and photos.

What a reconstruction finds in minutes is known here. So a painting can be tried on a head in
seconds, and a stylisation be tested on a surface that is known.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lfportrait.capture import Camera
from lfportrait.field import C0, VoxelField

from .head_model import HeadModel
from .people import SITTER
from .studio import EXTENT, Picture, distances, photograph, studio_cameras

__all__ = ["head_field"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

_INSIDE, _OUTSIDE = 3.5, 2.0
"""Layers of points that are kept behind the surface and before it."""
_OPAQUE = 80.0


def head_field(model: HeadModel = SITTER, step: int = 2, cameras: Camera | None = None,
               ) -> VoxelField:
    """A modelled head as a field of degree 0.

    Parameters
    ----------
    model : The head.
    step : The lattice has every ``step``-th point of the 257 of the baked distances, a divisor
        of 256.
    cameras : Where it is photographed from for its colors, by default 12 of the demo's.

    Returns
    -------
    field : In the portrait frame, with a clear layer around the surface.
    """
    grid = distances(model)[::step, ::step, ::step]
    count = len(grid)
    cell = 2 * EXTENT / (count - 1)
    away = grid / cell
    filled = (away > -_INSIDE) & (away < _OUTSIDE)
    links = np.full(grid.shape, -1, np.int32)
    links[filled] = np.arange(int(filled.sum()), dtype=np.int32)
    slopes = np.stack([plane[filled] for plane in np.gradient(grid)[::-1]], axis=1)
    normals = slopes / np.maximum(np.linalg.norm(slopes, axis=1, keepdims=True), 1e-9)
    points = np.argwhere(filled)[:, ::-1] * cell - EXTENT
    on = points - grid[filled][:, None] * normals
    density = (_OPAQUE * np.clip(0.5 - away[filled], 0, 1)).astype(np.float32)
    color = _colors(model, on, normals, 2 * cell, cameras or studio_cameras(224, 12))
    return VoxelField(links, density, ((color - 0.5) / C0)[:, :, None].astype(np.float32),
                      np.zeros(3), np.full(3, count * cell / 2))


def _colors(model: HeadModel, points: Float64, normals: Float64, near: float, cameras: Camera,
            ) -> Float64:
    """Colors [N, 3] in [0, 1] of the surface's points, by the photographs that see them best."""
    total = np.zeros((len(points), 3))
    weights = np.full(len(points), 1e-9)
    places = cameras.project(points)[0].astype(np.float32) - np.float32(0.5)
    for view, eye in enumerate(np.asarray(cameras.pose)[:, :3, 3]):
        seen, color = _seen(photograph(model, cameras, view), places[view], eye - points, normals,
                            near)
        weights += seen
        total += seen[:, None] * color
    known = weights > 1e-6
    if not known.all():
        nearest = cKDTree(points[known]).query(points[~known])[1]
        total[~known], weights[~known] = total[known][nearest], weights[known][nearest]
    return total / weights[:, None]


def _seen(picture: Picture, places: Float32, to_eye: Float64, normals: Float64, near: float,
          ) -> tuple[Float64, Float32]:
    """How well a photograph sees points, [N], 0 where it does not, and its colors there."""
    distance = np.linalg.norm(to_eye, axis=1)
    facing = (normals * to_eye).sum(axis=1) / distance
    solid = (picture.image[..., 3] == 255).astype(np.float32)
    depth = _at(np.where(solid > 0, picture.depth, np.float32(1e3)), places)
    hit = (np.abs(depth - distance) < near) & (facing > 0.15) & (_at(solid, places) > 0.99)
    weight = np.where(hit, np.maximum(facing, 0) ** 4, 0)
    return weight, _at(picture.image[..., :3].astype(np.float32) / np.float32(255), places)


def _at(picture: Float32, places: Float32) -> Float32:
    """Values of a picture [H, W(, 3)] at places (x, y) [N, 2], between four pixels."""
    rows = 16384  # OpenCV takes at most 32767
    padded = np.pad(places, ((0, -len(places) % rows), (0, 0))).reshape(-1, rows, 2)
    found = [cv2.remap(picture, part[:, :1].copy(), part[:, 1:].copy(), cv2.INTER_LINEAR)
             for part in padded]
    return np.asarray(np.concatenate(found).reshape(-1, *picture.shape[2:])[:len(places)],
                      np.float32)
