"""What takes the steps of a level: the CPU here, a GPU in `gpu_stepping`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..background import BackgroundTrainer
from ..config import Settings
from ..kernels.descent import descend
from .casting import Caster, Descent
from .lattice import Average, Lattice
from .pixels import TrainingPixels
from .steps import DECAY, color_gains, smooth_run

__all__ = ["CpuSteps", "Plan", "Steps", "Taken"]


@dataclass(frozen=True)
class Plan:
    """One step.

    Attributes
    ----------
    tiles
        int32 [T, 3] (view, row, column).
    blocks
        int [T], the tiles' blocks, by which `Batches` learns of their errors.
    greys
        float32 [T], the grey behind each tile; spheres behind the lattice replace it.
    rate, rate_sh
        Learning rates of density and color.
    place
        Where the run of rows begins that total variation smooths, from 0 to 1.
    background_rates
        Learning rates of the spheres' color and density.
    averaged
        Whether the state after the step counts for the average.
    """

    tiles: NDArray[np.int32]
    blocks: NDArray[np.int64]
    greys: NDArray[np.float32]
    rate: np.float32
    rate_sh: np.float32
    place: float
    background_rates: tuple[float, float]
    averaged: bool


_TOGETHER = 16
"""Steps of a call at most: enough that a call's own time does not count, and little to wait for."""

Taken = Callable[[Plan, NDArray[np.float32], float], None]
"""Called after a step with its plan, the tiles' squared errors [T], and their sum."""


class Steps(Protocol):
    """What takes the steps of one level, at once or later."""

    average: Average | None
    """Sums of states, as far as they are known here."""
    table: NDArray[np.int32] | None
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


class CpuSteps:
    """Steps on the CPU, many in one call unless spheres behind the lattice learn, too.

    Parameters
    ----------
    lattice, data, config, level
        What is trained, the pixels, the parameters, and the level's number.
    basis, workers
        Harmonics a channel, and threads.
    options
        See `lfportrait.field.kernels.train.make_cast`.
    lowest
        Densities are kept at or above this.
    scale
        Gives float32 [V, 3], what 8-bit colors of each view are multiplied with.
    taken
        Called after each step.
    """

    def __init__(self, lattice: Lattice, data: TrainingPixels, config: Settings,
                 level: int, basis: int, workers: int, options: NDArray[np.float64],
                 lowest: np.float32, scale: Callable[[], NDArray[np.float32]], taken: Taken,
                 ) -> None:
        self.lattice, self.data, self.config, self.level = lattice, data, config, level
        self.basis, self.width = basis, lattice.rows.shape[1]
        self.options, self.lowest, self.scale, self.taken = options, lowest, scale, taken
        self.caster = Caster(lattice, data, basis, workers)
        self.behind: BackgroundTrainer | None = None
        self.average: Average | None = None
        self.table: NDArray[np.int32] | None = None
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

    def go_on_with(self, table: NDArray[np.int32]) -> None:
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
