"""Calling the device for a panel: which eyes colors are evaluated for, and what is sent."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...field import VoxelField
from ...field.gpu import keep_field
from ...gpu import GpuProcess
from .panel import PanelJob

__all__ = ["code_on_gpu", "viewpoints"]

_APART = math.radians(3.0)
"""Angle between neighbouring eyes that colors are evaluated for."""
_LAYERS = 16
"""Most such eyes."""
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
