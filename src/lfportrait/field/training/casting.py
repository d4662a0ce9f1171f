"""Training rays cast through one lattice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...simd.barrier import together
from ..config import Settings
from ..kernels.bricks import bright_table
from ..kernels.packet import Records, make_pad
from ..kernels.steps import steps_kernel, train_kernel
from .lattice import Lattice
from .pixels import TrainingPixels
from .steps import DECAY, variation_of

__all__ = ["Caster", "Descent"]


@dataclass(frozen=True)
class Descent:
    """What the steps of a level have in common, besides how rays are cast.

    Attributes
    ----------
    neighbours
        int32 [N + 1, 6], as `lfportrait.field.kernels.descent.total_variation` takes them.
    variation
        float32 [3]: weights of the density's and the colors' total variation over the rows of a
        run, and the scale of differences.
    slopes, color_slopes
        float32 [R] and [R * width], scratch: R rows are a run.
    decay, lowest
        Of the density's running mean of squared slopes; densities are kept at or above this.
    gains
        float32 [width], from `color_gains`.
    """

    neighbours: NDArray[np.int32]
    variation: NDArray[np.float32]
    slopes: NDArray[np.float32]
    color_slopes: NDArray[np.float32]
    decay: np.float32
    lowest: np.float32
    gains: NDArray[np.float32]

    @staticmethod
    def of(lattice: Lattice, config: Settings, level: int, lowest: np.float32,
           gains: NDArray[np.float32]) -> Descent:
        """That of a level; ``lowest`` and ``gains`` are given."""
        weights, scale, run = variation_of(config, level, lattice.count)
        return Descent(
            lattice.neighbours(), np.array([*(weight / run for weight in weights), scale],
                                           np.float32),
            np.zeros(run, np.float32), np.zeros(run * len(gains) if weights[1] > 0 else 1,
                                                np.float32),
            DECAY, lowest, gains)


class Caster:
    """Casts rays through a lattice, forward and backward.

    Parameters
    ----------
    lattice
        What to cast through; its values may change between casts, its points may not.
    data
        The pixels.
    basis
        Harmonics a channel.
    workers
        Threads that cast, each with records of its own.

    Attributes
    ----------
    records
        What the last cast found (`lfportrait.field.kernels.packet.Records`).
    bases
        float32 [T, 64], harmonics of the last cast's packets.
    errors
        float32 [T], squared errors of the last cast's tiles.
    losses
        float64 [workers, 3], of the last cast: squared errors, rays, samples.
    """

    def __init__(self, lattice: Lattice, data: TrainingPixels, basis: int, workers: int) -> None:
        self.lattice, self.data, self.basis = lattice, data, basis
        self._whole, self.links, self.geometry = lattice.geometry()
        self.table = self._whole
        self.pad = make_pad(workers, self.table, len(self.links) // 128)
        self.records = Records.empty(workers, 1 << 14)
        self.bases, self.errors = np.zeros((0, 64), np.float32), np.zeros(0, np.float32)
        self.losses = np.zeros((workers, 3))
        self.place()

    def place(self) -> None:
        """Cast rays from the cameras that the pixels have now."""
        self._cameras = self.data.cameras.copy()

    def _run(self, tiles: NDArray[np.int32], ground: NDArray[np.float32],
             scale: NDArray[np.float32], options: NDArray[np.float64],
             slopes: NDArray[np.float32], seen: NDArray[np.float32]) -> None:
        lattice, data = self.lattice, self.data
        # A slice with gaps is another type of array, for which all would be compiled once more.
        tiles = np.ascontiguousarray(tiles)
        self._fit(len(tiles))
        train_kernel(lattice.rows.shape[1])(
            self.table, self.links, lattice.density, lattice.rows.ravel(), self.geometry,
            self.basis, self._cameras, data.sizes, data.starts, data.pixels, scale, tiles, ground,
            options, self.pad, self.records.arrays, self.bases, slopes, seen, self.errors,
            self.losses)

    def _fit(self, tiles: int) -> None:
        """Have room for what a cast of so many tiles leaves."""
        if len(self.bases) != tiles:
            self.bases = np.zeros((tiles, 64), np.float32)
            self.errors = np.zeros(tiles, np.float32)

    def cast(self, tiles: NDArray[np.int32], ground: NDArray[np.float32],
             scale: NDArray[np.float32], options: NDArray[np.float64]) -> NDArray[np.float32]:
        """Cast the rays of tiles; leaves ``records``, ``bases`` and ``losses``.

        Parameters
        ----------
        tiles
            int32 [T, 3] (view, row, column).
        ground
            float32 [16 T, 3], the background of each ray.
        scale
            float32 [V, 3], what 8-bit colors of each view are multiplied with.
        options
            See `lfportrait.field.kernels.train.make_cast`.

        Returns
        -------
        slopes
            float32 [16 T, 3], slope of the loss by each ray's background.
        """
        slopes = np.empty_like(ground)
        unused = np.zeros((len(self.losses), 1), np.float32)
        while True:
            self._run(tiles, ground, scale, options, slopes, unused)
            grown = self.records.grown()
            if grown is None:
                return slopes
            self.records = grown

    def take(self, tiles: NDArray[np.int32], greys: NDArray[np.float32], scale: NDArray[np.float32],
             options: NDArray[np.float64], descent: Descent, rates: NDArray[np.float32],
             firsts: NDArray[np.int64]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Cast rays and take up what they found, step by step.

        Parameters
        ----------
        tiles, greys
            int32 [S, T, 3] (view, row, column) of each step, and the grey behind each, [S, T].
        scale, options
            As for `cast`.
        descent
            What all steps have in common.
        rates
            float32 [S, 2], the density's rate, and the weight of rays that colors are means of.
        firsts
            int64 [S], where the run of rows begins that total variation smooths.

        Returns
        -------
        errors
            float32 [S, T], squared errors of the tiles.
        losses
            float64 [S, W, 3], as ``losses`` of each step.
        """
        lattice, data, width = self.lattice, self.data, self.lattice.rows.shape[1]
        steps, count = tiles.shape[:2]
        self._fit(count)
        errors = np.empty((steps, count), np.float32)
        losses = np.zeros((steps, *self.losses.shape))
        grounds = np.repeat(np.repeat(greys[..., None], 3, axis=2), 16, axis=1)
        slopes = np.empty_like(grounds[0])
        unused = np.zeros((len(self.losses), 1), np.float32)
        done = np.zeros(len(self.losses), np.int64)
        while True:
            together(
                steps_kernel(width), len(self.losses), done, False, self.table, self.links,
                lattice.density, lattice.rows.ravel(), self.geometry, self.basis, self._cameras,
                data.sizes, data.starts, data.pixels, scale, tiles, grounds, options, self.pad,
                self.records.arrays, self.bases, slopes, unused, descent.neighbours,
                descent.variation, rates, firsts, descent.slopes, descent.color_slopes,
                descent.decay, descent.lowest, descent.gains, errors, losses)
            grown = self.records.grown()
            if grown is None:
                self.errors, self.losses = errors[-1], losses[-1]
                return errors, losses
            self.records = grown

    def skip_clear(self, least: float) -> None:
        """Let rays leap over bricks in which no density is above ``least``, from now on."""
        self.table = bright_table(self._whole, self.links, self.lattice.density, least)

    def largest(self, tiles: NDArray[np.int32], scale: NDArray[np.float32],
                options: NDArray[np.float64]) -> NDArray[np.float32]:
        """The largest weight of each row on the rays of tiles: float32 [N + 1]."""
        seen = np.zeros((len(self.losses), len(self.lattice.density)), np.float32)
        options = options.copy()
        options[6] = 1.0
        self._run(tiles, np.zeros((16 * len(tiles), 3), np.float32), scale, options,
                  np.zeros((1, 3), np.float32), seen)
        return np.asarray(seen.max(axis=0))
