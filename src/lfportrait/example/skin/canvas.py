"""The atlas at a painting's resolution, and the lists of a skin that it shows.

A preview paints every second pixel: it needs a quarter of the lists.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..kernels.atlas import spread
from ..patches import at_middles, coarser_owner
from .sitter import Skin

__all__ = ["Canvas", "canvas_of"]

Float32 = NDArray[np.float32]

_LISTS = ("index", "tone", "detail", "appearance", "contours", "hair", "clothes", "ears",
          "seen", "outwards")


@dataclass
class Canvas:
    """The atlas at the painting's resolution: owners, and where the skin's lists go."""

    step: int
    owner: NDArray[np.int32]
    slots: NDArray[np.int32]
    surface: NDArray[np.bool_]

    @staticmethod
    def of(skin: Skin, step: int) -> Canvas:
        """Every ``step``-th pixel (a power of two) of the atlas."""
        atlas = skin.atlas
        level = step.bit_length() - 1
        shape = atlas.depth.shape[0] // step, atlas.depth.shape[1] // step
        if step == 1:
            return Canvas(1, atlas.owner, skin.slots, np.isfinite(atlas.depth))
        owner = coarser_owner(atlas.owner, level, shape)
        # An owner shows what its middle shows, even if that is another's.
        slots = skin.slots_of(at_middles(atlas.owner, level, shape)).reshape(-1)
        filled = np.where(owner >= 0, slots[np.maximum(owner, 0)], -1)
        return Canvas(step, owner, np.ascontiguousarray(filled.reshape(shape)),
                       np.isfinite(at_middles(atlas.depth, level, shape)))

    @functools.cached_property
    def own(self) -> NDArray[np.bool_]:
        """Pixels that own their surface point, bool [H, W]."""
        index = np.arange(self.owner.size, dtype=np.int32).reshape(self.owner.shape)
        return np.asarray((self.owner == index) & (self.slots >= 0))

    def spread(self, values: Float32, empty: float = 0.0) -> Float32:
        """Values [N, C] of a skin's lists as a picture [H, W, C]."""
        out = np.empty((*self.slots.shape, values.shape[1]), np.float32)
        spread(np.ascontiguousarray(values, np.float32), self.slots, np.float32(empty), out)
        return out

    def gathered(self, picture: Float32, count: int, empty: float = 0.0) -> Float32:
        """What owners show of a picture [H, W], for each of ``count`` places of the lists, [N]."""
        own = self.own
        out = np.full(count, empty, np.float32)
        out[self.slots[own]] = picture[own]
        return out


def canvas_of(skin: Skin, step: int) -> tuple[Canvas, Skin]:
    """The canvas at every ``step``-th pixel, and the skin with the lists that it shows alone.

    Both are made once and kept with the skin.
    """
    return skin.once(("canvas", step), lambda: _canvas_of(skin, step))


def _canvas_of(skin: Skin, step: int) -> tuple[Canvas, Skin]:
    canvas = Canvas.of(skin, step)
    if step == 1:
        return canvas, skin
    shown = np.zeros(len(skin.index) + 1, bool)
    shown[canvas.slots] = True
    used = np.flatnonzero(shown[:-1])  # the last one stands for none, -1
    number = np.full(len(skin.index) + 1, -1, np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    lists = {name: value[used] for name in _LISTS if (value := getattr(skin, name)) is not None}
    return (replace(canvas, slots=number[canvas.slots]), replace(skin, kept={}, **lists))
