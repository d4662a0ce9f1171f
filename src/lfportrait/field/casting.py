"""What casting training rays costs on the lattice that a reconstruction arrived at."""

from __future__ import annotations

import time

import numpy as np

from ..kernels.train import train_kernel
from .pixels import Batches
from .trainer import Trainer

__all__ = ["casting_figures"]


def casting_figures(trainer: Trainer, batches: int = 4) -> dict[str, float]:
    """What casting rays forward and backward costs, nothing else.

    Parameters
    ----------
    trainer
        A reconstruction that is finished.
    batches
        How many to cast; the fastest counts.

    Returns
    -------
    figures
        ``rays_per_second`` of the kernel alone; ``samples_per_ray``; ``rows_per_ray``, lattice
        points that a worker's share of a batch touches by its number of rays; ``row_width``, values
        a point.
    """
    lattice, data, config = trainer.lattice, trainer.data, trainer.config
    assert lattice is not None
    table, links, geometry = lattice.geometry()
    last = len(config.resolutions) - 1
    order = Batches(data, config.batch[last] // 16, config.seed, last)
    gradients = np.zeros((trainer.workers, lattice.rows.size), np.float32)
    losses = np.zeros((trainer.workers, 3))
    fastest, samples, rows, rays = np.inf, 0.0, 0, 0
    for number in range(batches):
        tiles = order.step(number)
        touched = np.zeros((trainer.workers, lattice.count + 1), np.uint8)
        ground = np.ones((16 * len(tiles), 3), np.float32)
        start = time.perf_counter()
        train_kernel(trainer.width)(
            table, links, lattice.density, lattice.rows.ravel(), geometry, trainer.basis,
            data.cameras, data.sizes, data.starts, data.pixels, trainer.scale, tiles, ground,
            trainer.options(), gradients, np.empty_like(ground), touched,
            np.zeros((trainer.workers, 1), np.float32), losses)
        fastest = min(fastest, (time.perf_counter() - start) / (16 * len(tiles)))
        samples += float(losses[:, 2].sum())
        rows += int(touched[:, :-1].sum())
        rays += 16 * len(tiles)
    return {"rays_per_second": 1.0 / fastest, "samples_per_ray": samples / rays,
            "rows_per_ray": rows / rays, "row_width": trainer.width}
