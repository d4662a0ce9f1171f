"""A field's painted texture on a device, for `march.wgsl`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Float32, UInt8
from ...gpu.device import Device
from ..texture import TextureRows

__all__ = ["DeviceTexture", "TextureParts", "keep_texture", "picture_texture", "texture_parts"]

_KEPT = 3
"""Textures that stay on a device."""


@dataclass(frozen=True)
class TextureParts:
    """A field's painted texture, as it is sent.

    Attributes
    ----------
    cells
        uint8 [bricks * 128], the chart of each cell; 255: none.
    charts
        float32 [C, 12], from the lattice to texels.
    texels
        int8 [H, W, 4].
    """

    cells: UInt8
    charts: Float32
    texels: NDArray[np.int8]


@dataclass(frozen=True)
class DeviceTexture:
    """The same on a device: buffers and a texture; ``there``: the field has one at all."""

    cells: Any
    charts: Any
    texels: Any
    there: bool


def texture_parts(rows: TextureRows) -> TextureParts:
    """What `VoxelField.texture_rows` gives, as it is sent."""
    cells, charts, texels = rows
    words = np.ascontiguousarray(texels)
    return TextureParts(cells.astype(np.uint8), charts,
                        words.view(np.int8).reshape(*words.shape, 4))


def keep_texture(device: Device, key: str, parts: TextureParts | None) -> list[str]:
    """Keep a texture, or that there is none, on a device; returns the names of all kept."""
    kept = device.kept.setdefault("textures", {})
    kept.pop(key, None)
    while len(kept) >= _KEPT:
        kept.pop(next(iter(kept)))
    if parts is None:
        kept[key] = DeviceTexture(device.buffer(16), device.buffer(48),
                                  device.texture((1, 1), "rgba8snorm"), False)
    else:
        texels = device.texture(parts.texels.shape[1::-1], "rgba8snorm")
        device.fill_texture(texels, parts.texels)
        kept[key] = DeviceTexture(device.buffer(parts.cells), device.buffer(parts.charts), texels,
                                  True)
    return list(kept)


def picture_texture(device: Device, planes: Float32 | None) -> Any:
    """A texture of half floats of a picture float32 [3, H, W], 0 to 255; None: a black texel."""
    if planes is None:
        return device.texture((1, 1), "rgba16float")
    _, height, width = planes.shape
    texels = np.zeros((height, width, 4), np.float16)
    texels[..., :3] = np.moveaxis(planes, 0, -1) * np.float32(1 / 255)
    texture = device.texture((width, height), "rgba16float")
    device.fill_texture(texture, texels)
    return texture
