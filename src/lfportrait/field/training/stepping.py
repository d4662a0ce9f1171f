"""Steps of a level on the CPU: their sizes, rays cast through a lattice, and what takes the steps.

Sizes are learning rates, color gains and total variation (Eq. 3). A GPU takes the same steps in
`gpu_stepping`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ...arrays import Float32, Float64, Int32, Int64
from ...simd.threads import together
from ..background import BackgroundTrainer
from ..config import Settings
from ..kernels.bricks import bright_table
from ..kernels.descent import descend, smooth, total_variation
from ..kernels.packet import Records, make_pad
from ..kernels.train import steps_kernel, train_kernel
from .lattice import Average, Lattice
from .pixels import TrainingPixels

DECAY = np.float32(0.95)  # Decay of RMSProp's running mean, for the density; svox2's.
_BANDS = (0.7, 0.15, 0.15)
"""Share of a ray's error that each band of harmonics takes up: mostly the color that all
directions share, so that highlights do not settle where matter is still wrong."""


def falling(first: float, last: float, done: float) -> np.float32:
    """Learning rates fall geometrically with the share of the rays that are done."""
    return np.float32(first * (last / first) ** done)


def color_gains(rays: int, basis: int, width: int) -> Float32:
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

    Weights of the density's and of the colors', what differences between neighbours are multiplied
    by, and the rows that are smoothed in a step.
    """
    finest = level == len(config.resolutions) - 1
    return ((config.lambda_tv * 0.5 ** level, config.lambda_tv_sh * (0.1 if finest else 1.0)),
            config.resolutions[level] / 256.0, max(1, int(config.tv_sparsity * count)))


def smooth_run(lattice: Lattice, config: Settings, level: int, neighbours: Int32, place: float,
               rate: np.float32, lowest: np.float32, gains: Float32) -> None:
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


@dataclass(frozen=True)
class Descent:
    """What the steps of a level have in common, besides how rays are cast."""

    # int32 [N + 1, 6], as `lfportrait.field.kernels.descent.total_variation` takes them.
    neighbours: Int32
    # float32 [3]: weights of the density's and the colors' total variation over the rows of a run,
    # and the scale of differences.
    variation: Float32
    # slopes, color_slopes: float32 [R] and [R * width], scratch: R rows are a run.
    slopes: Float32
    color_slopes: Float32
    # decay, lowest: Of the density's running mean of squared slopes; densities are kept at or above
    # this.
    decay: np.float32
    lowest: np.float32
    gains: Float32  # float32 [width], from `color_gains`.

    @staticmethod
    def of(lattice: Lattice, config: Settings, level: int, lowest: np.float32,
           gains: Float32) -> Descent:
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
    lattice : What to cast through; its values may change between casts, its points may not.
    basis : Harmonics a channel.
    workers : Threads that cast, each with records of its own.

    Attributes
    ----------
    records : What the last cast found (`lfportrait.field.kernels.packet.Records`).
    bases : float32 [T, 64], harmonics of the last cast's packets.
    errors : float32 [T], squared errors of the last cast's tiles.
    losses : float64 [workers, 3], of the last cast: squared errors, rays, samples.
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

    def _run(self, tiles: Int32, ground: Float32, scale: Float32, options: Float64, slopes: Float32,
             seen: Float32) -> None:
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

    def cast(self, tiles: Int32, ground: Float32, scale: Float32, options: Float64) -> Float32:
        """Cast the rays of tiles; leaves ``records``, ``bases`` and ``losses``.

        Parameters
        ----------
        tiles : int32 [T, 3] (view, row, column).
        ground : float32 [16 T, 3], the background of each ray.
        scale : float32 [V, 3], what 8-bit colors of each view are multiplied with.
        options : See `lfportrait.field.kernels.train.make_cast`.

        Returns
        -------
        slopes : float32 [16 T, 3], slope of the loss by each ray's background.
        """
        slopes = np.empty_like(ground)
        unused = np.zeros((len(self.losses), 1), np.float32)
        while True:
            self._run(tiles, ground, scale, options, slopes, unused)
            grown = self.records.grown()
            if grown is None:
                return slopes
            self.records = grown

    def take(self, tiles: Int32, greys: Float32, scale: Float32, options: Float64, descent: Descent,
             rates: Float32, firsts: Int64) -> tuple[Float32, Float64]:
        """Cast rays and take up what they found, step by step.

        Parameters
        ----------
        tiles, greys : int32 [S, T, 3] (view, row, column) of each step, and the grey behind
            each, [S, T].
        scale, options : As for `cast`.
        descent : What all steps have in common.
        rates : float32 [S, 2], the density's rate, and the weight of rays that colors are means
            of.
        firsts : int64 [S], where the run of rows begins that total variation smooths.

        Returns
        -------
        errors : float32 [S, T], squared errors of the tiles.
        losses : float64 [S, W, 3], as ``losses`` of each step.
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

    def largest(self, tiles: Int32, scale: Float32, options: Float64) -> Float32:
        """The largest weight of each row on the rays of tiles: float32 [N + 1]."""
        seen = np.zeros((len(self.losses), len(self.lattice.density)), np.float32)
        options = options.copy()
        options[5] = 1.0
        self._run(tiles, np.zeros((16 * len(tiles), 3), np.float32), scale, options,
                  np.zeros((1, 3), np.float32), seen)
        return np.asarray(seen.max(axis=0))


@dataclass(frozen=True)
class Plan:
    """One step."""

    tiles: Int32  # int32 [T, 3] (view, row, column).
    blocks: Int64  # int [T], the tiles' blocks, by which `Batches` learns of their errors.
    greys: Float32  # float32 [T], the grey behind each tile; spheres behind the lattice replace it.
    # rate, rate_sh: Learning rates of density and color.
    rate: np.float32
    rate_sh: np.float32
    place: float  # Where the run of rows begins that total variation smooths, from 0 to 1.
    background_rates: tuple[float, float]  # Learning rates of the spheres' color and density.
    averaged: bool  # Whether the state after the step counts for the average.


_TOGETHER = 16
"""Steps of a call at most: enough that a call's own time does not count, and little to wait for."""

Taken = Callable[[Plan, Float32, float], None]
"""Called after a step with its plan, the tiles' squared errors [T], and their sum."""


class Steps(Protocol):
    """What takes the steps of one level, at once or later."""

    average: Average | None
    """Sums of states, as far as they are known here."""
    table: Int32 | None
    """Table of bricks that rays are cast by, as far as it is known here; None: of all bricks."""

    def take(self, plan: Plan) -> None:
        """Take a step, now or with those that follow; ``taken`` is called once it is done."""

    def flush(self) -> None:
        """Take the steps that wait."""

    def look_again(self, least: float) -> None:
        """Let rays leap over bricks in which no density is above ``least``, from now on."""

    def place(self) -> None:
        """The pixels' cameras have changed."""

    def sync(self, last: bool = False) -> None:
        """Bring the lattice's values here, and the average's.

        ``last``: the training is over, after which the average is what counts, if there is one.
        """

    def close(self) -> None:
        """The level is over, or has failed."""


class StepData(NamedTuple):
    """A level of the training, for what takes its steps."""

    lattice: Lattice  # What is trained.
    data: TrainingPixels
    config: Settings
    number: int
    basis: int  # Harmonics a channel.
    workers: int  # Threads.
    options: Float64  # See `lfportrait.field.kernels.train.make_cast`.
    lowest: np.float32  # Densities are kept at or above this.
    # Gives float32 [V, 3], what 8-bit colors of each view are multiplied with.
    scale: Callable[[], Float32]
    taken: Taken  # Called after each step.


class CpuSteps:
    """Steps on the CPU, many in one call unless spheres behind the lattice learn, too."""

    def __init__(self, level: StepData) -> None:
        self.lattice, self.data, self.config = level.lattice, level.data, level.config
        self.level = level.number
        self.basis, self.width = level.basis, level.lattice.rows.shape[1]
        self.options, self.lowest = level.options, level.lowest
        self.scale, self.taken = level.scale, level.taken
        self.caster = Caster(level.lattice, level.data, level.basis, level.workers)
        self.behind: BackgroundTrainer | None = None
        self.average: Average | None = None
        self.table: Int32 | None = None
        self._waiting: list[Plan] = []
        # The first one is taken at once, so that its error is known.
        self._together = 1
        self._common: Descent | None = None

    def take(self, plan: Plan) -> None:
        """Let a step wait; with enough of them, take them all."""
        if self.behind is not None:
            self._take_before(self.behind, plan)
            return
        self._waiting.append(plan)
        if len(self._waiting) >= self._together or plan.averaged:
            self._together = min(2 * self._together, _TOGETHER)
            self.flush()

    def flush(self) -> None:
        """Take the steps that wait."""
        plans, self._waiting = self._waiting, []
        if not plans:
            return
        errors, losses = self.caster.take(
            np.stack([plan.tiles for plan in plans]), np.stack([plan.greys for plan in plans]),
            self.scale(), self.options, self._descent(len(plans[0].tiles)),
            np.array([(plan.rate, 1.0 / plan.rate_sh) for plan in plans], np.float32),
            np.array([int(plan.place * self.lattice.count) for plan in plans]))
        for number, plan in enumerate(plans):
            self.taken(plan, errors[number], float(losses[number, :, 0].sum()))
        if plans[-1].averaged:
            self._average()

    def _descent(self, tiles: int) -> Descent:
        """What steps of so many tiles have in common."""
        if self._common is None:
            self._common = Descent.of(self.lattice, self.config, self.level, self.lowest,
                                      color_gains(16 * tiles, self.basis, self.width))
        return self._common

    def _take_before(self, behind: BackgroundTrainer, plan: Plan) -> None:
        """Take a step before spheres, which learn from its rays."""
        lattice, config, caster, tiles = self.lattice, self.config, self.caster, plan.tiles
        rays = self.data.cube_rays(tiles, lattice.center, lattice.radius)
        ground = behind.background.color(rays, config.background)
        slopes = caster.cast(tiles, ground, self.scale(), self.options)
        self.taken(plan, caster.errors, float(caster.losses[:, 0].sum()))
        gains = color_gains(16 * len(tiles), self.basis, self.width)
        descend(lattice.density, lattice.rows.ravel(), self.width, caster.records.arrays,
                caster.bases, plan.rate, DECAY, self.lowest, gains,
                np.float32(1.0) / plan.rate_sh)
        smooth_run(lattice, config, self.level, lattice.neighbours(), plan.place, plan.rate,
                   self.lowest, gains)
        behind.step(rays, ground, slopes, *plan.background_rates)
        if plan.averaged:
            self._average()

    def _average(self) -> None:
        """Add the state to the average."""
        self.average = self.average or Average(self.lattice, 3 * self.basis)
        self.average.add(self.lattice)

    def look_again(self, least: float) -> None:
        """Let rays leap over bricks in which no density is above ``least``, from now on."""
        self.flush()
        self.caster.skip_clear(least)
        self.table = self.caster.table

    def go_on_with(self, table: Int32) -> None:
        """Cast rays by a table that `look_again` gave."""
        self.table = self.caster.table = table

    def place(self) -> None:
        """The pixels' cameras have changed."""
        self.flush()
        self.caster.place()

    def sync(self, last: bool = False) -> None:
        """Take the steps that wait; the lattice is here."""
        self.flush()

    def close(self) -> None:
        """Nothing is held; steps that wait are not taken."""
        self._waiting.clear()
