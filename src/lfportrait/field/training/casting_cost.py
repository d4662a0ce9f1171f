"""Time of the ray casting kernels alone, on the rays of a finished reconstruction."""

from __future__ import annotations

import time

import numpy as np

from ...gpu import GpuProcess
from ..kernels.descent import descend
from .casting import Caster
from .gpu_stepping import GpuSteps
from .pixels import Batches
from .stepping import Plan
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
        of lattice points that a batch leaves by its number of rays; ``row_width``, values a point;
        ``batch``, rays of a step.
        On a GPU all kernels of a step count.
    """
    if trainer.process is not None:
        return _on_gpu(trainer, trainer.process, batches)
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
            "rows_per_ray": records / rays, "row_width": trainer.width,
            "batch": rays // batches}


def _on_gpu(trainer: Trainer, process: GpuProcess, batches: int) -> dict[str, float]:
    """The same of the steps on a GPU."""
    lattice, data, config = trainer.lattice, trainer.data, trainer.config
    assert lattice is not None
    last = len(config.resolutions) - 1
    order = Batches(data, config.batch[last] // 16, config.seed, last)
    samples, records, rays, fastest = 0.0, 0, 0, np.inf
    for number in range(batches):
        tiles = order.step(number)
        steps = GpuSteps(process, lattice, data, config, last, trainer.basis, trainer.workers,
                         trainer.options(), np.float32(0.0), lambda: trainer.scale,
                         lambda *_: None, len(tiles), trainer.background_trainer())
        steps.look_again(float(trainer.options()[1]))
        found = steps.measure(Plan(tiles, order.blocks, np.ones(len(tiles), np.float32),
                                   np.float32(0.0), np.float32(1.0), 0.0, (0.0, 0.0), False),
                              100 if process.adapter.real else 1)
        steps.close()
        fastest = min(fastest, found["seconds"] / (16 * len(tiles)))
        samples += found["samples"]
        records += found["records"]
        rays += 16 * len(tiles)
    return {"rays_per_second": 1.0 / fastest, "samples_per_ray": samples / rays,
            "rows_per_ray": records / rays, "row_width": trainer.width,
            "batch": rays // batches}
