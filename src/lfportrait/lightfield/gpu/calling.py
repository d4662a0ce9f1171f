"""Calling the device: what a field and a panel send to it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...field import VoxelField
from ...gpu import GpuProcess
from .panel import PanelJob, TextureParts

__all__ = ["code_on_gpu", "keep_field", "viewpoints"]

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


def keep_field(process: GpuProcess, field: VoxelField, layers: int, footprint: float,
               ) -> tuple[str, str]:
    """Have a field and its texture on the device; returns their names there.

    Parameters
    ----------
    process, field
        The device's process, and the field.
    layers
        Eyes that its colors are kept for.
    footprint
        Width of the texture's detail that is wanted (`VoxelField.texture_rows`).
    """
    # The field's own module loads this one's package.
    from ...field.gpu.atlas import field_parts

    bricks = field.bricks
    key = f"{bricks.token} {layers}"
    if not process.holds("fields", key):
        process.note("fields", process.call("lfportrait.field.gpu.atlas:upload", key,
                                            field_parts(bricks, field.lattice), layers))
    texture, name = None, "none"
    if field.texture is not None:
        name = f"{bricks.token} {field.texture.level(footprint, whole=True)}"
        if not process.holds("textures", name):
            cells, charts, texels = field.texture_rows(footprint, whole=True)
            words = np.ascontiguousarray(texels)
            texture = TextureParts(cells.astype(np.uint8), charts,
                                   words.view(np.int8).reshape(*words.shape, 4))
    if not process.holds("textures", name):
        process.note("textures", process.call("lfportrait.lightfield.gpu.panel:keep_texture", name,
                                              texture))
    return key, name


def code_on_gpu(process: GpuProcess, field: VoxelField, job: PanelJob, footprint: float,
                read: bool = True, repeats: int = 0) -> tuple[NDArray[np.uint8], dict[str, Any]]:
    """Code a panel on the device (`code_panel`), where the field is sent first if it must be."""
    keys = keep_field(process, field, len(job.viewpoints), footprint)
    job = replace(job, eyes=np.asarray(job.eyes, np.float64))
    image, figures = process.call("lfportrait.lightfield.gpu.panel:code_panel", keys, job, read,
                                  repeats)
    return image, figures
