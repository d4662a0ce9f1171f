"""Train a head for a while after it was closed.

Where a head is closed, guessed matter meets what photos saw: it hides a shoulder that they saw
slantingly, or ends in another color than theirs. Photos know better wherever they see it. So the
closed lattice is trained as the last level was, at its final rates: what a ray meets is made right,
total variation carries colors across the border, and what no ray meets stays.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..config import Settings
from ..grid import VoxelField
from .averaging import Average
from .lattice import Lattice
from .pixels import IMPORTANCE, Batches, TrainingPixels
from .stepping import CpuSteps, Plan

__all__ = ["settled"]

_SHARE = 0.25
"""Rays that are cast, over those of the last level: usually three millions. Held-out views gain
0.9 dB by the first, 0.3 by each of the next two, and 0.1 by the fourth."""
_STILL = 16
"""Steps at first in which densities stay: a step is as long as the slopes before it allow."""
_AVERAGED = 0.5
"""Share of the steps, at the end, whose states are averaged."""


class Trained(Protocol):
    """What is read of a trainer (`Trainer`)."""

    data: TrainingPixels
    config: Settings
    basis: int
    width: int
    workers: int
    rays_done: int

    @property
    def scale(self) -> NDArray[np.float32]:
        """What 8-bit colors of each view are multiplied with, [V, 3]."""

    def options(self) -> NDArray[np.float64]:
        """Options of the kernels."""


def settled(trainer: Trained, field: VoxelField) -> VoxelField:
    """A field of a trainer's photos, with matter added to it, after some more rays.

    Parameters
    ----------
    trainer
        Its last level is done. It stays as it is.
    field
        Without a texture, on a lattice as fine as the last level's.

    Returns
    -------
    field
        The same lattice points.
    """
    config, level = trainer.config, len(trainer.config.resolutions) - 1
    count, colors = len(field.density), 3 * trainer.basis
    lattice = Lattice(field.links, np.append(field.density, np.float32(0)),
                      np.zeros((count + 1, trainer.width), np.float32), field.center, field.radius)
    lattice.rows[:count, :colors] = field.sh.reshape(count, colors)
    # Colors are means of as many rays as count at the end of a training: one ray more changes
    # them little.
    lattice.rows[:, -2] = 1.0 / config.lr_sh_final
    batches = Batches(trainer.data, config.batch[level] // 16, config.seed, level + 1,
                      IMPORTANCE)
    steps = CpuSteps(lattice, trainer.data, config, level, trainer.basis, trainer.workers,
                     trainer.options(), np.float32(-config.density_floor / lattice.voxel),
                     lambda: trainer.scale,
                     lambda plan, errors, _: batches.learn(errors, plan.blocks))
    steps.look_again(trainer.options()[1])
    rays = _SHARE * min(1e6 * config.rays[level], float(trainer.rays_done))
    number = max(1, round(rays / (16 * batches.size)))
    rate = np.float32(config.lr_sigma_final * config.resolutions[level] / 256.0)
    for step in range(number):
        if batches.chooses(step):
            steps.flush()
        generator = batches.generator(0, step)
        tiles = batches.step(step)
        steps.take(Plan(
            tiles, batches.blocks, generator.random(len(tiles), np.float32),
            np.float32(0) if step < _STILL else rate, np.float32(config.lr_sh_final),
            float(generator.random()), (0.0, 0.0),
            Average.due(step / number, (step + 1) / number, _AVERAGED)))
    steps.flush()
    if steps.average is not None:
        steps.average.put(lattice)
    return VoxelField(lattice.links, lattice.density[:count].copy(),
                      np.ascontiguousarray(lattice.rows[:count, :colors]
                                           .reshape(count, 3, trainer.basis)),
                      field.center, field.radius, field.frame, field.background)
