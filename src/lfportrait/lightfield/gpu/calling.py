"""Calling the device for a panel: which eyes colors are evaluated for, and what is sent."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...capture import Camera
from ...field import VoxelField, camera_row
from ...field.gpu import PROBES, REACH, ViewJob, keep_field, views_on_gpu
from ...gpu import GpuProcess
from ..ground import Ground
from .panel import PanelJob

__all__ = ["code_on_gpu", "pictures_on_gpu", "viewpoints"]

_APART = math.radians(3.0)
"""Angle between neighbouring eyes that colors are evaluated for."""
_LAYERS = 16
"""Most such eyes."""
_STEEP = 0.77
"""Cosine between a camera's axis and the lattice's from which planes lie close enough."""
_MEMORY = 512 << 20
"""Bytes that their colors may take."""


def viewpoints(field: VoxelField, eyes: NDArray[np.float64], distance: float, height: float,
               to_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Eyes that colors are evaluated for, float64 [L, 3] in the field's world.

    Parameters
    ----------
    field
        The field; colors of one coefficient are the same for all eyes.
    eyes
        float64 [V], x of the views' eyes in the deep display frame, `distance` away and `height`
        up.
    to_world
        float64 [3, 4], from that frame to the world.
    """
    first, last = float(eyes[0]), float(eyes[-1])
    layers = 1
    if field.basis > 1:
        cone = math.atan(abs(last) / distance) + math.atan(abs(first) / distance)
        room = _MEMORY // (8 * len(field.bricks.links))
        layers = max(1, min(math.ceil(cone / _APART), _LAYERS, room))
    share = (np.arange(layers) + 0.5) / layers
    places = np.stack([first + (last - first) * share, np.full(layers, height),
                       np.full(layers, distance), np.ones(layers)])
    return np.ascontiguousarray((to_world @ places).T)


def code_on_gpu(process: GpuProcess, field: VoxelField, job: PanelJob, footprint: float,
                read: bool = True, repeats: int = 0) -> tuple[NDArray[np.uint8], dict[str, Any]]:
    """Code a panel on the device (`code_panel`), where the field is sent first if it must be."""
    keys = keep_field(process, field, len(job.viewpoints), footprint)
    image, figures = process.call("lfportrait.lightfield.gpu.panel:code_panel", keys, job, read,
                                  repeats)
    return image, figures


def pictures_on_gpu(process: GpuProcess, field: VoxelField, cameras: Camera, *, background: float,
                    ground: Ground | None) -> NDArray[np.uint8]:
    """Pictures of cameras of one size, uint8 [V, H, W, 3], with what is behind the field.

    Rays are sampled on the lattice's planes, as row slices are, and at half steps where they are
    oblique.
    """
    count = len(cameras)
    details = [field.detail_of(cameras, view) for view in range(count)]
    # Views of the same width of detail go together.
    levels = [0 if field.texture is None else field.texture.level(wide) for wide, _ in details]
    out = np.empty((count, int(cameras.height[0]), int(cameras.width[0]), 3), np.uint8)
    for level in sorted(set(levels)):
        some = [view for view in range(count) if levels[view] == level]
        job = _picture_job(field, cameras, some, details[some[0]][1], background, ground)
        out[some] = views_on_gpu(process, field, job, details[some[0]][0])
    return out


def _picture_job(field: VoxelField, cameras: Camera, views: list[int], covered: float,
                 background: float, ground: Ground | None) -> ViewJob:
    """Some views of one width of the texture's detail, as pictures of bytes."""
    ahead = np.abs(cameras.pose[views, 2, 2])
    axis, step = (3, 1.0) if ahead.min() > _STEEP else (0, 0.5)
    rays = None if ground is None else np.stack([ground.rays(cameras, view) for view in views])
    return ViewJob(np.stack([camera_row(cameras, view) for view in views]),
                   (int(cameras.width[0]), int(cameras.height[0])), field.lattice, axis, step,
                   2e-4 * field.lattice[5] if axis else 1e-2, 4e-3 if axis else 1e-3, axis > 0,
                   covered, PROBES, REACH, True, (background,) * 3,
                   None if ground is None else ground.planes, rays)
