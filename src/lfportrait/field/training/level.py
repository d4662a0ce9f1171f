"""Levels of a training: which steps, at which rates, and what comes between them.

Where a head is closed, guessed matter meets what photos saw: it hides a shoulder that they saw
slantingly, or ends in another color than theirs. Photos know better wherever they see it. So the
closed lattice is trained for a while as the last level was, at its final rates (`settled`): what a
ray meets is made right, total variation carries colors across the border, and what no ray meets
stays. Where it is known what was added, only the parts of the photos that show that are asked: with
as many rays these are looked at more than twice as often, and a face stays as it was.
"""

from __future__ import annotations

import time
from typing import Protocol

import numpy as np

from ...arrays import Float32, Float64
from ...gpu import GpuProcess
from ...progress import Progress
from ..config import Settings
from ..geometry.mattes import refined_mattes
from ..grid import VoxelField
from .checkpoint import State
from .gpu_stepping import GpuSteps, fits_gpu, warn
from .lattice import Average, Lattice
from .pixels import IMPORTANCE, Batches, TrainingPixels
from .stepping import CpuSteps, Plan, Steps, falling

LR_SH = 2.5
"""Learning rate of the colors at the start: 1 / N, if a color is the running mean over N rays.
(Colors step as in SART, not by RMSProp as in svox2.)"""
LR_SIGMA_BG, LR_COLOR_BG = 3.0, 0.1
"""Learning rates of the background's density and color at the start, those of svox2; the first
falls like the density's, the second to a twentieth."""
_LOOK_AGAIN = 400
"""Steps after which it is looked again for bricks that have become clear."""
_LAY_AGAIN = 0.4
"""Share of the finest level after which mattes are recomputed: its outline is finer by then."""


class Trained(Protocol):
    """What is read of a trainer (`Trainer`)."""

    data: TrainingPixels
    config: Settings
    basis: int
    width: int
    workers: int
    rays_done: int

    @property
    def scale(self) -> Float32:
        """What 8-bit colors of each view are multiplied with, [V, 3]."""

    def options(self) -> Float64:
        """Options of the kernels."""


class Training(State, Trained, Protocol):
    """The state of a reconstruction (`Trainer`) as its levels read and change it."""

    process: GpuProcess | None
    progress: Progress | None
    steps: Steps | None
    lays_mattes: bool

    def deadline(self) -> float:
        """When the level must end, by the clock of `time.perf_counter`."""

    def pace(self, least: float = 0.0) -> float:
        """When the level has had its share of the time."""

    def field(self) -> VoxelField:
        """The field as it is."""

    def sync(self, last: bool = False) -> None:
        """Bring here what the steps have come to."""

    def tell(self, done: float) -> None:
        """Report the progress."""

    def save_now_and_then(self) -> None:
        """Write a checkpoint if it is time."""


class Level:
    """The level that a trainer is at, whose state is up to date after each step."""

    def __init__(self, trainer: Training) -> None:
        self.trainer = trainer
        config, lattice = trainer.config, trainer.lattice
        assert lattice is not None
        self.begun, self.deadline = time.perf_counter(), trainer.deadline()
        level, last = trainer.level, len(config.resolutions) - 1
        self.finest = level == last
        self.count = max(1.0, np.round(config.rays[level] * 1e6 / config.batch[level]))
        self.paced = config.paced and not self.finest
        self.until = trainer.pace() if self.paced else self.deadline
        shares = config.shares()
        self.before, self.share = sum(shares[:level]), shares[level]
        self.resumed = trainer.level_done
        self.options = trainer.options()
        # Without mattes the first, wrong, gradients would clear space for good: until the last
        # level a trace of density stays, which can grow again.
        self.lowest = np.float32(-config.density_floor / lattice.voxel
                                 if trainer.data.has_alpha or self.finest
                                 else 2.0 * self.options[1])
        if trainer.behind is None:
            trainer.behind = trainer.background_trainer()
        if trainer.batches is None:
            trainer.batches = trainer.new_batches()
        self.batches = trainer.batches
        self.steps = self._steps()

    def _steps(self) -> Steps:
        """What takes the steps."""
        trainer = self.trainer
        assert trainer.lattice is not None
        given = (trainer.lattice, trainer.data, trainer.config, trainer.level, trainer.basis,
                 trainer.workers, self.options, self.lowest, lambda: trainer.scale, self._taken)
        if trainer.process is not None and not fits_gpu(trainer.lattice):
            trainer.process = None
            warn(trainer.progress, "a lattice of more than 1023 points a side is trained on the "
                 "CPU")
        if trainer.process is not None:
            return GpuSteps(trainer.process, *given, tiles=self.batches.size,
                            behind=trainer.behind, average=trainer.average, table=trainer.table)
        steps = CpuSteps(*given)
        steps.behind, steps.average = trainer.behind, trainer.average
        if trainer.table is not None:
            steps.go_on_with(trainer.table)
        return steps

    def run(self) -> float:
        """Train; returns the mean squared error of the last steps."""
        trainer = self.trainer
        trainer.steps = self.steps
        while (trainer.step < self.count
               or (self.paced and time.perf_counter() < self.until)):
            was = trainer.level_done
            if self.batches.chooses(trainer.step):
                self.steps.flush()
            plan = self._plan()
            if trainer.step % _LOOK_AGAIN == 0:
                self.steps.look_again(self.options[1])
            self.steps.take(plan)
            trainer.step += 1
            trainer.rays_done += 16 * len(plan.tiles)
            trainer.tell(self.before + self.share * trainer.level_done)
            self._between(was)
            if time.perf_counter() > self.deadline:
                break
            trainer.save_now_and_then()
        trainer.sync(self.finest)
        # They call this level: neither would be freed before Python looks for cycles.
        del self.steps
        return float(trainer.recent[0] / max(trainer.recent[1], 1.0))

    def _plan(self) -> Plan:
        """The next step."""
        trainer, config, data = self.trainer, self.trainer.config, self.trainer.data
        generator = self.batches.generator(0, trainer.step)
        tiles = self.batches.step(trainer.step)
        if data.has_alpha:
            greys = generator.random((len(tiles), 1), np.float32)[:, 0]
        else:
            greys = np.full(len(tiles), config.background, np.float32)
        # Rates fall by rays or by the clock: a paced level goes by what is behind, others by what
        # is ahead.
        was, now = trainer.level_done, time.perf_counter()
        by_clock = self.resumed + (1.0 - self.resumed) * (now - self.begun) / (
            self.until - self.begun)
        trainer.level_done = min(1.0, (min if self.paced else max)(
            (trainer.step + 1) / self.count, by_clock))
        done = self.before + self.share * trainer.level_done
        rate = falling(config.lr_sigma, config.lr_sigma_final, done)
        if data.has_alpha:
            # A step changes the optical depth of a voxel alike, whatever its size.
            rate *= np.float32(config.resolutions[trainer.level] / 256.0)
        elif trainer.level == 0:
            rate *= np.float32(min(1.0, 0.01 + trainer.step / 100.0))
        averaged = self.finest and Average.due(was, trainer.level_done, config.polyak_fraction)
        return Plan(tiles, self.batches.blocks, greys, rate,
                    falling(LR_SH, config.lr_sh_final, done), float(generator.random()),
                    (float(LR_COLOR_BG * 0.05 ** done),
                     float(LR_SIGMA_BG * rate / config.lr_sigma)), averaged)

    def _taken(self, plan: Plan, errors: Float32, squared: float) -> None:
        """Learn from a step's errors."""
        self.batches.learn(errors, plan.blocks)
        self.trainer.recent = 0.98 * self.trainer.recent + np.array([squared,
                                                                     48 * len(plan.tiles)])

    def _between(self, was: float) -> None:
        """Correct cameras and mattes, where it is time; ``was`` is what was done a step before."""
        trainer = self.trainer
        if trainer.poses is not None and trainer.poses.due(trainer.level, trainer.level_done,
                                                           self.finest):
            trainer.place(trainer.poses.refine(trainer.field(), trainer.capture, trainer.gains))
            self.steps.place()
        if trainer.lays_mattes and self.finest and was < _LAY_AGAIN <= trainer.level_done:
            trainer.lay_mattes(refined_mattes(trainer.field(), trainer.capture))


_SHARE = 0.25
"""Rays that are cast, over those of the last level: usually three millions. Held-out views gain
0.9 dB by the first, 0.3 by each of the next two, and 0.1 by the fourth."""
_SHARE_OF_NEW = 0.4
"""The same where only what is new is asked: half of it costs outlines 0.2 dB before a full wall."""
_PASSES = 8.0
"""Times that each tile is asked at most where only some are, usually less than once."""
_STILL = 16
"""Steps at first in which densities stay: a step is as long as the slopes before it allow."""
_AVERAGED = 0.5
"""Share of the steps, at the end, whose states are averaged."""


def settled(trainer: Trained, field: VoxelField, share: float | None = None,
            new: tuple[Float64, Float64] | None = None) -> VoxelField:
    """A field of a trainer's photos, with matter added to it, after some more rays.

    The trainer's last level is done, and it stays as it is. The field has no texture and a lattice
    as fine as the last level's, and its lattice points stay. ``share`` are the rays that are cast,
    over those of the last level; None: a quarter, or two fifths of ``new``: places of the surface
    that was added and its outward normals there, float64 [N, 3] each; only tiles that show any are
    asked.
    """
    config, level = trainer.config, len(trainer.config.resolutions) - 1
    count, colors = len(field.density), 3 * trainer.basis
    lattice = Lattice(field.links, np.append(field.density, np.float32(0)),
                      np.zeros((count + 1, trainer.width), np.float32), field.center, field.radius)
    lattice.rows[:count, :colors] = field.sh.reshape(count, colors)
    # Colors are means of as many rays as count at the end of a training: one ray more changes
    # them little.
    lattice.rows[:, -2] = 1.0 / config.lr_sh_final
    tiles = None if new is None else trainer.data.showing(*new)
    if tiles is not None and not len(tiles):
        return field
    batches = Batches(trainer.data, config.batch[level] // 16, config.seed, level + 1,
                      IMPORTANCE, tiles)
    steps = CpuSteps(lattice, trainer.data, config, level, trainer.basis, trainer.workers,
                     trainer.options(), np.float32(-config.density_floor / lattice.voxel),
                     lambda: trainer.scale,
                     lambda plan, errors, _: batches.learn(errors, plan.blocks))
    steps.look_again(trainer.options()[1])
    if share is None:
        share = _SHARE if new is None else _SHARE_OF_NEW
    rays = share * min(1e6 * config.rays[level], float(trainer.rays_done))
    if new is not None:
        rays = min(rays, _PASSES * 16.0 * len(batches.tiles))
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
