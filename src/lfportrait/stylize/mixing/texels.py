"""Textures of several paintings, mixed as the colors of the lattice's rows are.

A texture holds differences, so that a share of a painting takes the same share of its texture. The
photo has none. What takes the painting's luma away takes that of its texture, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .tones import LUMA

__all__ = ["mixed_texels"]

BLOCK = 4
"""Texels across a block, which takes its shares in a mix from one lattice row."""
_BAND = 32
"""Rows of blocks mixed at a time."""


def mixed_texels(texels: NDArray[np.int8], rows: NDArray[np.int32], amounts: Mapping[int, Any],
                 identity: float = 0.0, luma_alone: bool = False) -> NDArray[np.int8]:
    """Texels of a mix, int8 [H, W, 3].

    Parameters
    ----------
    texels
        int8 [S, H, W, 3], of S styles at full strength.
    rows
        int32 [H / 4, W / 4], rounded up: the lattice row of each block.
    amounts
        How much of each style, by its number: a number, or one for each lattice row.
    identity
        Share of the luma that gives way to the photo's, 0 to 1.
    luma_alone
        Leave out all chroma.
    """
    used = {n: amount for n, amount in amounts.items() if np.any(amount)}
    if len(used) == 1 and identity == 0 and not luma_alone:
        [(n, amount)] = used.items()
        if np.all(amount == 1):
            return texels[n]
    out = np.zeros(texels.shape[1:], np.int8)
    for first in range(0, len(rows), _BAND):
        band = slice(BLOCK * first, BLOCK * (first + _BAND))
        mixed = np.zeros(out[band].shape, np.float32)
        for n, amount in used.items():
            mixed += _shares(amount, rows[first:first + _BAND], mixed.shape) * texels[n, band]
        if identity > 0 or luma_alone:
            light = (mixed @ LUMA)[..., None]
            kept = np.float32(1 - identity) * light
            mixed = np.broadcast_to(kept, mixed.shape) if luma_alone else mixed - light + kept
        out[band] = np.clip(np.rint(mixed), -127, 127)
    return out


def _shares(amount: Any, rows: NDArray[np.int32], shape: tuple[int, ...]) -> Any:
    """A number, or what texels [H, W, ...] take by the rows of their blocks, float32 [H, W, 1]."""
    if np.ndim(amount) == 0:
        return np.float32(amount)
    share = np.asarray(amount, np.float32)[rows].repeat(BLOCK, 0).repeat(BLOCK, 1)
    return share[:shape[0], :shape[1], None]
