"""Many steps of a training in one call, by threads that wait for each other in the kernel.

A step has four parts, and no thread begins one before all have done the one before: rays are cast
(`train`), their records are taken up (`descent`), the rows of a run are compared with their
neighbours, and smoothed. From the second part on each row has an owner, worker (row / 64) modulo
the number of workers, whoever cast the rays that met it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ...simd.decorators import identified, kernel, lean
from ...simd.threads import meet, together, with_kernel
from .descent import smooth_rows, take_up_all, vary_rows
from .packet import OWNED
from .train import make_cast, make_scratch


@lean
def _own_run(owner, workers, block, first, last):
    """The part of block ``block`` of a run that belongs to a worker, counted from ``first``."""
    if block % workers != owner:
        return 0, 0
    return max(OWNED * block, first) - first, min(OWNED * (block + 1), last) - first


@lean
def _vary(owner, workers, first, last, neighbours, density, rows, width, variation, slopes,
          color_slopes):
    """Slopes of the total variation of a worker's rows of a run."""
    for block in range(first // OWNED, (last - 1) // OWNED + 1):
        since, until = _own_run(owner, workers, block, first, last)
        if variation[0] > 0:
            vary_rows(since, until, neighbours, first, density, 1, variation[0], variation[2],
                      slopes)
        if variation[1] > 0:
            vary_rows(since, until, neighbours, first, rows, width, variation[1], variation[2],
                      color_slopes)


@lean
def _smooth(owner, workers, first, last, density, rows, width, variation, slopes, color_slopes,
            rate, decay, lowest, gains):
    """Take up those slopes."""
    length = last - first
    for block in range(first // OWNED, (last - 1) // OWNED + 1):
        since, until = _own_run(owner, workers, block, first, last)
        if variation[0] > 0:
            smooth_rows(since, until, density, rows, width, slopes[:length], first, last, rate,
                        decay, lowest, gains)
        if variation[1] > 0:
            smooth_rows(since, until, density, rows, width, color_slopes[:length * width], first,
                        last, rate, decay, lowest, gains)


@lean
def _fits(counts, room):
    """Whether there was room for all records."""
    for worker in range(len(counts)):
        for owner in range(len(counts)):
            if counts[worker, owner] > room:
                return False
    return True


@functools.cache
def steps_kernel(width: int) -> Callable[..., Any]:
    """The kernel for color rows of 16 or 32 floats.

    Returns
    -------
    steps : ``steps(number, threads, bell, done, alone, table, links, density, rows, lattice, count,
        cameras, sizes, starts, pixels, scale, tiles, grounds, options, pad, records, bases,
        grad_background, weight, neighbours, variation, rates, firsts, slopes, color_slopes, decay,
        lowest, gains, errors, losses)``, called `together`; see `make_cast` and `descend` for what
        is not named here. ``done`` int64 [threads], the steps that are done, read and written: less
        than all of them where there was too little room for the records of the next one. ``alone``:
        rays are cast, and that is all. ``tiles`` int32 [S, T, 3], ``grounds`` float32 [S, 16 T, 3],
        the backgrounds of their rays. ``variation`` float32 [3], weights of the density's and the
        colors' total variation by the length of a run, and the scale of differences. ``rates``
        float32 [S, 2], the density's rate and the colors' memory; ``firsts`` int64 [S], where each
        run begins; ``slopes`` [R] and ``color_slopes`` [R * width] float32, scratch of the run's
        length. ``errors`` float32 [S, T] and ``losses`` float64 [S, W, 3] are written.
    """
    cast = make_cast(width)

    @identified("take steps", width)
    @kernel
    def steps(number, threads, bell, done, alone, table, links, density, rows, lattice, count,
              cameras, sizes, starts, pixels, scale, tiles, grounds, options, pad, records, bases,
              grad_background, weight, neighbours, variation, rates, firsts, slopes, color_slopes,
              decay, lowest, gains, errors, losses):
        scratch = make_scratch(lattice, options)
        workers, points = losses.shape[1], len(density) - 1
        keys, values, written, _ = records
        flat = bases.reshape(-1)
        while done[number] < len(tiles):
            step = done[number]
            first = firsts[step]
            last = min(points, first + len(slopes))
            for worker in range(number, workers, threads):
                losses[step, worker, 0], losses[step, worker, 1], losses[step, worker, 2] = cast(
                    worker, workers, table, links, density, rows, lattice, count, cameras, sizes,
                    starts, pixels, scale, tiles[step], grounds[step], options, pad, records,
                    bases, grad_background, weight, errors[step], scratch)
            if alone:
                done[number] = step + 1
                continue
            if not meet(bell, threads) or not _fits(written, keys.shape[2]):
                return
            for worker in range(number, workers, threads):
                take_up_all(worker, worker + 1, keys, values, written, density, rows, width, flat,
                            rates[step, 0], decay, lowest, gains, rates[step, 1])
            if not meet(bell, threads):
                return
            for worker in range(number, workers, threads):
                _vary(worker, workers, first, last, neighbours, density, rows, width, variation,
                      slopes, color_slopes)
            if not meet(bell, threads):
                return
            for worker in range(number, workers, threads):
                _smooth(worker, workers, first, last, density, rows, width, variation, slopes,
                        color_slopes, rates[step, 0], decay, lowest, gains)
            done[number] = step + 1
            if not meet(bell, threads):
                return
    return steps


@functools.cache
def train_kernel(width: int) -> Callable[..., Any]:
    """One cast of rays alone, for color rows of 16 or 32 floats.

    Returns
    -------
    train : ``train(table, links, density, rows, lattice, count, cameras, sizes, starts, pixels,
        gains, tiles, background, options, pad, records, bases, grad_background, weight,
        tile_errors, losses)``: as `make_cast`, by all workers; ``losses`` float64 [W, 3] are
        written: squared errors, rays, samples.
    """
    steps = steps_kernel(width)
    # Not read in a cast alone.
    neighbours, none = np.zeros((1, 6), np.int32), np.zeros(3, np.float32)
    rates, firsts = np.zeros((1, 2), np.float32), np.zeros(1, np.int64)

    def train(table, links, density, rows, lattice, count, cameras, sizes, starts, pixels, gains,
              tiles, background, options, pad, records, bases, grad_background, weight,
              tile_errors, losses):
        together(steps, len(losses), np.zeros(len(losses), np.int64), True, table, links, density,
                 rows, lattice, count, cameras, sizes, starts, pixels, gains, tiles[None],
                 background[None], options, pad, records, bases, grad_background, weight,
                 neighbours, none, rates, firsts, none, none, none[0], none[0], none,
                 tile_errors[None], losses[None])
    return with_kernel(train, steps)
