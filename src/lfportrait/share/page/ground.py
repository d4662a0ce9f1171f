"""The painted ground of a page: a picture with the head's shadow, and its mean color.

The page draws the picture as a plane behind the head (`web/ground.glsl`); the color is that of the
page where nothing is drawn.
"""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image

from ...field import Backdrop, VoxelField
from ...lightfield import EncodeConfig, backdrop_of, world_ground

__all__ = ["PageGround", "ground_style"]

_LONGEST = 720
"""Pixels of the picture's longer side: a ground is soft, and lies behind."""
_QUALITY = 78

_DARK, _LIGHT = 0.16, 0.88
"""Luma of a page's ground, at most and at least: its text must stay legible."""


@dataclass(frozen=True)
class PageGround:
    """A page's ground.

    Attributes
    ----------
    header
        For the page's script: ``picture``, a WebP as an address; ``left``, ``top``, ``width`` and
        ``height`` in world units; ``depth``, how far it lies behind the head's middle; and for
        panels ``back``, where the head's back is in the world, ``behind``, how far behind that the
        ground lies in half panel heights, and ``blur`` (`EncodeConfig`).
    drop
        What it was made from.
    """

    header: dict[str, Any]
    drop: Backdrop

    @property
    def size(self) -> int:
        """Bytes in the page."""
        return len(self.header["picture"])

    @staticmethod
    def of(voxels: VoxelField, config: EncodeConfig) -> PageGround | None:
        """What panels show behind a field; None where that is a grey level."""
        drop = backdrop_of(voxels, config)
        if drop is None:
            return None
        longest = max(drop.picture.shape[:2])
        plane = world_ground(voxels, config, max(longest / _LONGEST, 1.0) / drop.pixels)
        assert plane is not None
        picture = np.clip(plane.planes.transpose(1, 2, 0) + 0.5, 0, 255).astype(np.uint8)
        buffer = io.BytesIO()
        Image.fromarray(picture).save(buffer, "WEBP", quality=_QUALITY, method=2)
        across, down = plane.texel
        return PageGround({
            "picture": "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode(),
            "left": round(plane.left - across / 2, 5), "top": round(plane.top + down / 2, 5),
            "width": round(across * picture.shape[1], 5),
            "height": round(down * picture.shape[0], 5), "depth": round(plane.depth, 5),
            "back": round(config.ground_depth / EncodeConfig.size - plane.depth, 5),
            "behind": config.ground_depth, "blur": config.ground_blur}, drop)


def ground_style(backdrop: Backdrop | None) -> tuple[str, bool]:
    """Style sheet of a page's ground, and whether the page begins with a light one.

    A painted ground that is dark takes the place of the page's dark one, a light one that of its
    light one: the other can be chosen as before. Without a painted ground the style is empty.
    """
    if backdrop is None:
        return "", False
    color = backdrop.color
    luma = float(color @ [0.299, 0.587, 0.114])
    light = luma > 0.5
    if light:
        ground = 1 - (1 - color) * min(1.0, (1 - _LIGHT) / max(1 - luma, 1e-3))
        glow = 1 - (1 - ground) * 0.4
    else:
        ground = color * min(1.0, _DARK / max(luma, 1e-3))
        glow = np.clip(1.6 * ground + 0.02, 0, 1)
    chosen = '[data-ground="light"]' if light else ':not([data-ground="light"])'
    return f"\n:root{chosen} {{ --ground: {_hex(ground)}; --glow: {_hex(glow)}; }}\n", light


def _hex(color: np.ndarray) -> str:
    """A color in [0, 1] for a style sheet."""
    return "#" + "".join(f"{round(255 * float(value)):02x}" for value in color)
