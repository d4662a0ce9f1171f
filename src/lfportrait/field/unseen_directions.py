"""Colors of a field for directions from which no photo was taken.

Photos of a narrow arc look at a point from nearly one direction. They say what color it has from
there, and how that changes a little to the sides; but a training spreads what it learns over all
coefficients alike, so that the mean over all directions, the zeroth coefficient, stays near the
gray that it began with, and the others make up for it where photos looked. Whoever looks from
further aside sees the gray come back, and the others' noise grow.

So the coefficients are fitted once more to the colors that they give in the photos' directions,
with a price on all but the zeroth (ridge regression, Hoerl and Kennard 1970): what photos tell
stays, and what they don't is no longer there. It is linear, and the same for all points of a place.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture import Camera
from ..simd.threads import side_by_side
from .grid import VoxelField
from .harmonics import real_harmonics

__all__ = ["with_steady_colors"]

Float64 = NDArray[np.float64]

PRICE = 0.003
"""Of a coefficient's square, over the mean square error of the colors. At three times more,
held-out photos inside the arc lost 0.1 to 0.3 dB."""
PHOTOS = 40
"""Photos, at most, whose directions are asked."""
BLOCK = 16
"""Lattice points along a side of a place that is treated alike."""
FACING = 6.0
"""Photos from the side that a place faces count up to exp(2 x this) times those from behind."""


def with_steady_colors(field: VoxelField, cameras: Camera, middle: NDArray[np.floating],
                       price: float = PRICE) -> VoxelField:
    """A field whose colors beyond its photos' directions go on as they are in them.

    Parameters
    ----------
    field
        Trained on photos; without a texture.
    cameras
        Of the photos.
    middle
        [3], inside the head, in the world: places are taken to face away from it.
    price
        Of a coefficient's square (`PRICE`).

    Returns
    -------
    field
        The same lattice points and densities.
    """
    if field.basis == 1:
        return field
    chosen = np.linspace(0, len(cameras) - 1, min(PHOTOS, len(cameras))).astype(int)
    positions = np.asarray(cameras.position[chosen], np.float64)
    flat = np.flatnonzero(field.links >= 0)
    rows = field.links.ravel()[flat]
    # In three dimensions `numpy.argwhere` takes four times as long.
    blocks: NDArray[Any] = np.stack(np.unravel_index(flat, field.links.shape), axis=1) // BLOCK
    number = np.ravel_multi_index(tuple(blocks.T), tuple(blocks.max(axis=0) + 1))
    order = np.argsort(number, kind="stable")
    since = np.flatnonzero(np.diff(number[order], prepend=-1))
    out = field.sh.copy()

    def steady(part: NDArray[Any]) -> None:
        center = (blocks[part[0], ::-1] + 0.5) * BLOCK * field.spacing + field.bounds[0]
        there = rows[part]
        out[there] = field.sh[there] @ _operator(center, positions, middle, field.basis, price).T

    side_by_side(steady, np.split(order, since[1:]))
    return replace(field, sh=out)


def _operator(center: Float64, positions: Float64, middle: NDArray[np.floating], basis: int,
              price: float) -> NDArray[np.float32]:
    """What coefficients [B] at a place [3] are multiplied with, float32 [B, B]."""
    away = center - positions
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    outwards = center - middle
    outwards /= max(float(np.linalg.norm(outwards)), 1e-9)
    weight = np.exp(-FACING * away @ outwards)
    harmonics = real_harmonics(away, basis) * np.sqrt(weight / weight.sum())[:, None]
    seen = harmonics.T @ harmonics
    priced = seen + price * np.diag(np.arange(basis) > 0)
    return np.asarray(np.linalg.solve(priced, seen), np.float32)
