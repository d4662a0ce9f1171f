"""Lower bound of the training time on this machine, beside the measured time."""

from __future__ import annotations

import time

import numba
import numpy as np

from lfportrait.gpu import GpuProcess

from .kernels.probe import multiply_adds, random_lines

__all__ = ["device_floor", "machine_rates", "training_floor"]


def machine_rates(megabytes: int = 512) -> dict[str, float]:
    """Random lines of 64 bytes and multiply-adds a second, all processors together.

    Parameters
    ----------
    megabytes
        Size of the table that lines are read from, a power of two far above the caches.
    """
    workers = numba.get_num_threads()
    table = np.ones(megabytes * 2 ** 18, np.float32)
    out = np.zeros((workers, 16), np.float32)
    lines, rounds = 8_000_000, 40_000_000
    random_lines(table, 1000, out)
    multiply_adds(1000, np.float32(0.5), out)
    best = [np.inf, np.inf]
    for _ in range(3):
        start = time.perf_counter()
        random_lines(table, lines, out)
        between = time.perf_counter()
        multiply_adds(rounds, np.float32(0.5), out)
        end = time.perf_counter()
        best = [min(best[0], between - start), min(best[1], end - between)]
    return {"random_lines_per_second": workers * lines / best[0],
            "multiply_adds_per_second": workers * rounds * 8 * 16 / best[1]}


def training_floor(rates: dict[str, float], samples: float, rows: float, width: int,
                   ) -> dict[str, float]:
    """Most rays a second that can be cast forward and backward.

    Parameters
    ----------
    rates
        Of `machine_rates`.
    samples
        Samples of a ray that take light.
    rows
        Records of lattice points that a ray leaves (its packet's, by sixteen): each point's row
        must come from memory to be seen, and come and go when its record is taken up.
    width
        Values of a lattice point's row, 4 bytes each.

    Returns
    -------
    figures
        ``lines_per_ray`` of 64 bytes, ``multiply_adds_per_ray``, ``memory_rays_per_second``,
        ``compute_rays_per_second`` and the smaller of the two, ``rays_per_second``.
    """
    lines = rows * 3.0 * width * 4.0 / 64.0
    # A sample: density, three colors and back five slopes of eight corners, and an exponential.
    # A point: three dot products, and its step.
    adds = samples * (8.0 * (1.0 + 3.0 + 5.0) + 60.0) + rows * (3.0 * 16.0 + 3.0 * width)
    memory = rates["random_lines_per_second"] / max(lines, 1e-9)
    compute = rates["multiply_adds_per_second"] / max(adds, 1e-9)
    return {"samples_per_ray": samples, "rows_per_ray": rows, "lines_per_ray": lines,
            "multiply_adds_per_ray": adds, "memory_rays_per_second": memory,
            "compute_rays_per_second": compute, "rays_per_second": min(memory, compute)}


def device_floor(process: GpuProcess, rays: int, rows: float, width: int) -> dict[str, float]:
    """Most rays a second that a GPU's memory lets be trained.

    Parameters
    ----------
    process
        The device's process.
    rays
        Rays of a step.
    rows, width
        As for `training_floor`.

    Returns
    -------
    figures
        ``rows_per_ray``, ``bytes_per_ray``, and ``rays_per_second``: a step's bytes copied within
        the device's memory, each read or written once.
    """
    moved = rows * 3.0 * width * 4.0
    seconds = process.call("lfportrait.gpu.measuring:copy_seconds", int(rays * moved / 2.0))
    return {"rows_per_ray": rows, "bytes_per_ray": moved, "rays_per_second": rays / seconds}
