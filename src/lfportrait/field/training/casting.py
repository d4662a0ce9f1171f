"""Training rays cast through one lattice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernels.bricks import bright_table
from ..kernels.packet import Records, make_pad
from ..kernels.train import train_kernel
from .lattice import Lattice
from .pixels import TrainingPixels

__all__ = ["Caster"]


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

    def _run(self, tiles: NDArray[np.int32], ground: NDArray[np.float32],
             scale: NDArray[np.float32], options: NDArray[np.float64],
             slopes: NDArray[np.float32], seen: NDArray[np.float32]) -> None:
        lattice, data = self.lattice, self.data
        # A slice with gaps is another type of array, for which all would be compiled once more.
        tiles = np.ascontiguousarray(tiles)
        if len(self.bases) != len(tiles):
            self.bases = np.zeros((len(tiles), 64), np.float32)
            self.errors = np.zeros(len(tiles), np.float32)
        train_kernel(lattice.rows.shape[1])(
            self.table, self.links, lattice.density, lattice.rows.ravel(), self.geometry,
            self.basis, data.cameras, data.sizes, data.starts, data.pixels, scale, tiles, ground,
            options, self.pad, self.records.arrays, self.bases, slopes, seen, self.errors,
            self.losses)

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
            See `lfportrait.field.kernels.train.train_kernel`.

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
