"""Step sizes of the training: learning rates, color gains, total variation (Eq. 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..config import Settings
from ..kernels.descent import smooth, total_variation
from .lattice import Lattice

__all__ = ["DECAY", "color_gains", "falling", "smooth_run", "variation_of"]

DECAY = np.float32(0.95)
"""Decay of RMSProp's running mean, for the density; svox2's."""
_BANDS = (0.7, 0.15, 0.15)
"""Share of a ray's error that each band of harmonics takes up: mostly the color that all
directions share, so that highlights do not settle where matter is still wrong."""


def falling(first: float, last: float, done: float) -> np.float32:
    """Learning rates fall geometrically with the share of the rays that are done."""
    return np.float32(first * (last / first) ** done)


def color_gains(rays: int, basis: int, width: int) -> NDArray[np.float32]:
    """What gradients of a step of ``rays`` rays are multiplied with, [width].

    The squares of a band's harmonics add up to (2 l + 1) / (4 pi) in every direction, so that
    a point that alone colors a ray makes good the share of the ray's error that it should. The
    loss's own factor, 2 / (3 rays), is taken out. ``basis`` is the number of harmonics, ``width``
    the length of a point's row.
    """
    gains = np.zeros(width, np.float32)
    band = np.sqrt(np.arange(basis)).astype(int)
    share = 4.0 * np.pi * np.array(_BANDS)[band] / (2 * band + 1)
    gains[:3 * basis] = np.tile(1.5 * rays * share, 3)
    return gains


def variation_of(config: Settings, level: int, count: int,
                 ) -> tuple[tuple[float, float], float, int]:
    """How a level's total variation is weighted, on a lattice of ``count`` points.

    Returns
    -------
    weights
        Of the density's and of the colors'.
    scale
        Differences between neighbours are multiplied by this.
    run
        Rows that are smoothed in a step.
    """
    finest = level == len(config.resolutions) - 1
    return ((config.lambda_tv * 0.5 ** level, config.lambda_tv_sh * (0.1 if finest else 1.0)),
            config.resolutions[level] / 256.0, max(1, int(config.tv_sparsity * count)))


def smooth_run(lattice: Lattice, config: Settings, level: int,
               neighbours: NDArray[np.int32], place: float, rate: np.float32,
               lowest: np.float32, gains: NDArray[np.float32]) -> None:
    """Total variation (Eq. 3) on a run of rows that begins at ``place``, from 0 to 1.

    ``lowest`` is the least density that stays, ``gains`` those of `color_gains`.
    """
    weights, scale, run = variation_of(config, level, lattice.count)
    first = int(place * lattice.count)
    last = min(lattice.count, first + run)
    flat = lattice.rows.ravel()
    for values, width, weight in zip((lattice.density, flat), (1, len(gains)), weights,
                                     strict=True):
        if weight > 0:
            slopes = np.empty((last - first) * width, np.float32)
            total_variation(neighbours, first, last, values, width, weight / run, scale, slopes)
            smooth(lattice.density, flat, len(gains), slopes, first, last, rate,
                   DECAY, lowest, gains)
