"""Time of the ray casting kernels alone, on the rays of a finished reconstruction."""

from __future__ import annotations

import time

import numpy as np

from ..kernels.descent import descend
from .casting import Caster
from .pixels import Batches
from .trainer import Trainer

__all__ = ["casting_figures"]


def casting_figures(trainer: Trainer, batches: int = 8) -> dict[str, float]:
    """Time of casting rays forward and backward, and of applying their gradients.

    Parameters
    ----------
    trainer
        A reconstruction that is finished.
    batches
        How many to cast; the fastest counts.

    Returns
    -------
    figures
        ``rays_per_second`` of the two kernels alone; ``samples_per_ray``; ``rows_per_ray``, records
        of lattice points that a batch leaves by its number of rays; ``row_width``, values a point.
    """
    zero = np.float32(0.0)
    lattice, data, config = trainer.lattice, trainer.data, trainer.config
    assert lattice is not None
    caster = Caster(lattice, data, trainer.basis, trainer.workers)
    caster.skip_clear(trainer.options()[1])
    last = len(config.resolutions) - 1
    order = Batches(data, config.batch[last] // 16, config.seed, last)
    fastest, samples, records, rays = np.inf, 0.0, 0, 0
    for number in range(batches):
        tiles = order.step(number)
        ground = np.ones((16 * len(tiles), 3), np.float32)
        start = time.perf_counter()
        caster.cast(tiles, ground, trainer.scale, trainer.options())
        # Steps of no length: the field stays as it is.
        descend(lattice.density, lattice.rows.ravel(), trainer.width, caster.records.arrays,
                caster.bases, zero, zero, zero, np.zeros(trainer.width, np.float32),
                np.float32(1.0))
        fastest = min(fastest, (time.perf_counter() - start) / (16 * len(tiles)))
        samples += float(caster.losses[:, 2].sum())
        records += int(caster.records.counts.sum())
        rays += 16 * len(tiles)
    return {"rays_per_second": 1.0 / fastest, "samples_per_ray": samples / rays,
            "rows_per_ray": records / rays, "row_width": trainer.width}
