"""The optimisation itself: one lattice, trained level by level (`field.reconstruction`)."""

from __future__ import annotations

import functools
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from ...cache import key_of
from ...capture import Capture
from ...errors import UserError
from ...measure import peak_memory_bytes
from ...progress import Progress
from ..background import Background, BackgroundTrainer
from ..config import ReconstructConfig
from ..geometry.exposure import matte_gains
from ..geometry.head_surface import HeadSurface, find_surface, is_narrow
from ..geometry.hull import ruled_out
from ..geometry.outlines import refined_mattes
from ..geometry.start import start_person, start_room
from ..grid import VoxelField
from ..kernels.bricks import row_width
from ..kernels.descent import descend
from ..quality import held_out_quality
from .averaging import Average
from .casting import Caster
from .checkpoint import deflated, read_checkpoint, write_checkpoint
from .lattice import Lattice, box_shape
from .meter import Meter
from .outlook import outlook
from .pixels import Batches, TrainingPixels
from .poses import PoseRefiner
from .steps import color_gains, falling, smooth_run

__all__ = ["Trainer"]

_SAVE_EVERY = 20.0  # seconds
_LOOK_AGAIN = 400
"""Steps after which it is looked again for bricks that have become clear."""
_LAY_AGAIN = 0.4
"""Share of the finest level after which mattes are recomputed: its outline is finer by then."""


class Trainer:
    """The state of one reconstruction."""

    def __init__(self, capture: Capture, config: ReconstructConfig,
                 progress: Progress | None = None, checkpoint: Path | None = None,
                 meter: Meter | None = None) -> None:
        self.original, self.capture, self.config, self.progress = capture, capture, config, progress
        self.checkpoint, self.meter = checkpoint, meter
        self.views = capture.training()
        if len(self.views) < 3:
            raise UserError(f"{len(self.views)} training views are too few; give 20 or more photos")
        self.data = TrainingPixels(capture, self.views)
        if not len(self.data.tiles):
            raise UserError("the mattes of all photos are empty: there is nothing to reconstruct")
        self.basis = (config.sh_degree + 1) ** 2
        self.width = row_width(self.basis)
        # Each worker casts its share of the packets, and owns its share of the lattice.
        self.workers = min(numba.get_num_threads(), 16)
        self.level, self.step, self.level_done, self.rays_done = 0, 0, 0.0, 0
        self.log: list[dict[str, Any]] = []
        self.lattice: Lattice | None = None
        self.background: Background | None = None
        # Of the level that is being trained.
        self.behind: BackgroundTrainer | None = None
        self.batches: Batches | None = None
        self.table: NDArray[np.int32] | None = None
        self.recent = np.zeros(2)
        self.average: Average | None = None
        # Exposures: what photos are divided by; held-out photos have theirs, too.
        self.gains = np.ones((len(self.views), 3))
        self.test_gains = np.ones((len(capture.testing()), 3))
        self.lays_mattes = capture.alphas is not None and config.refines_mattes(
            capture.figures.get("mattes"))
        # Recomputed mattes, deflated, as a checkpoint stores them.
        self.laid: NDArray[np.uint8] | None = None
        self.poses = PoseRefiner(capture, self.views) if config.refine_poses else None
        self.key = key_of("field.reconstruction", config, len(self.views),
                          int(self.data.pixels[::997].sum()), self.workers)
        self.began = self._saved = time.perf_counter()
        self._save_took = 0.0

    @property
    def scale(self) -> NDArray[np.float32]:
        """What the kernel multiplies 8-bit colors of each view with, [V, 3]."""
        return (1.0 / (255.0 * self.gains)).astype(np.float32)

    # -- state ------------------------------------------------------------------------------------

    def field(self) -> VoxelField:
        """The field as it is."""
        lattice = self.lattice
        assert lattice is not None
        count = lattice.count
        sh = lattice.rows[:count, :3 * self.basis].reshape(count, 3, self.basis)
        return VoxelField(lattice.links, lattice.density[:count].copy(), np.ascontiguousarray(sh),
                          lattice.center, lattice.radius, self.capture.frame, self.background)

    @functools.cached_property
    def surface(self) -> HeadSurface | None:
        """Where the person's surface is, if the photos are a narrow arc."""
        return find_surface(self.original) if is_narrow(self.original) else None

    def save(self) -> None:
        """Write the state: between two levels, or in the middle of one."""
        if self.checkpoint is not None and self.lattice is not None:
            start = time.perf_counter()
            write_checkpoint(self, self.checkpoint)
            self._saved = time.perf_counter()
            self._save_took = self._saved - start

    def _save_now_and_then(self) -> None:
        """Save every 20 s, or as seldom as takes a twentieth of the time where a state is large."""
        if self.checkpoint is not None and (time.perf_counter() - self._saved
                                            >= max(_SAVE_EVERY, 20.0 * self._save_took)):
            self.save()

    def restore(self) -> None:
        """Go on from a checkpoint of the same capture and parameters, if there is one."""
        if self.checkpoint is not None and self.checkpoint.is_file():
            read_checkpoint(self, self.checkpoint)

    # -- levels -----------------------------------------------------------------------------------

    def run_level(self) -> None:
        """Refine the lattice and train it, or go on with what a checkpoint holds."""
        config = self.config
        resolution = config.resolutions[self.level]
        begun = time.perf_counter()
        if self.step == 0:
            if self.lattice is None:
                self._first(resolution)
            else:
                self._refine(resolution)
            assert self.lattice is not None
            # Reset the optimiser's state of each point.
            self.lattice.rows[:, -2:] = 0.0
        error = self._train()
        assert self.lattice is not None
        self.log.append({"resolution": resolution, "voxels": self.lattice.count,
                         "train_psnr": round(-10 * float(np.log10(max(error, 1e-12))), 2),
                         "seconds": round(time.perf_counter() - begun, 2)})
        if self.level == 0 and len(config.resolutions) > 1 and self.data.has_alpha:
            self._foretell(begun)
        self.level, self.step, self.level_done = self.level + 1, 0, 0.0
        self.behind, self.batches, self.table, self.recent = None, None, None, np.zeros(2)
        self.save()

    def _foretell(self, begun: float) -> None:
        """Say what the levels after the first will take."""
        if self.progress is not None and self.lattice is not None:
            self.progress.say(outlook(self.config, time.perf_counter() - begun,
                                      self.lattice.count, self.lays_mattes, peak_memory_bytes()))

    def _first(self, resolution: int) -> None:
        """The lattice to start from."""
        if self.data.has_alpha:
            start = start_person(self.capture, self.views, resolution, self.width,
                                 self.config.init_opacity, self.surface)
        else:
            start = start_room(self.capture, self.views, self.data, self.config, resolution,
                               self.width)
            if start.haze:
                # Rays see through most of the cube at first, and the density must grow slowly:
                # wrong matter near the cameras would hide the rest.
                self.config = replace(self.config, lr_sigma=min(self.config.lr_sigma, 0.3))
        self.lattice, self.background = start.lattice, start.background
        self.gains, self.test_gains = start.gains, start.test_gains

    def _refine(self, resolution: int) -> None:
        """Prune what no training ray sees, and interpolate the rest on a finer lattice."""
        assert self.lattice is not None
        if self.data.has_alpha:
            field = self.field()
            if self.lays_mattes and self.level == len(self.config.resolutions) - 1:
                self.lay_mattes(refined_mattes(field, self.capture))
            if self.config.exposure:
                self._expose(field)
        spacing = 2.0 * self.lattice.radius / self.lattice.links.shape[::-1]
        growth = float(np.prod(0.5 * resolution * spacing))
        weights, least = self._largest_weights(), self.config.prune
        keep = self.lattice.seen(weights, least)
        while keep.sum() * growth > 1e6 * self.config.max_voxels and least < 1.0:
            least *= 1.5
            keep = self.lattice.seen(weights, least)
        lattice = self.lattice
        if self.data.has_alpha:
            keep &= lattice.attached()
            # The hull reaches far behind what no camera looks behind.
            lattice, keep = lattice.cropped(keep)
        if self.background is not None:
            self.background = self.background.upsampled()
        self.lattice = lattice.refined(box_shape(resolution, lattice.radius), keep)

    def lay_mattes(self, mattes: list[NDArray[np.uint8]]) -> None:
        """Go on with these mattes of all views."""
        self.capture = replace(self.capture, alphas=mattes)
        self.data.lay_mattes([mattes[view] for view in self.views])
        self.laid = deflated(mattes)

    def _expose(self, field: VoxelField) -> None:
        """Exposures of photos with mattes, from a field that is trained roughly."""
        gains = matte_gains(field, self.capture, self.views)
        if gains is None:
            return
        self.gains = gains / np.exp(np.log(gains).mean(axis=0))
        tests = self.capture.testing()
        if len(tests):
            found = matte_gains(field, self.capture, tests, least=0.0)
            if found is not None:
                self.test_gains = found

    def place(self, capture: Capture) -> None:
        """Go on with the cameras of ``capture``, whose photos are the same."""
        self.capture = capture
        self.data.place(capture.cameras[self.views])

    def finish(self) -> None:
        """After the last level, remove points that no ray sees or mattes rule out, and floaters."""
        assert self.lattice is not None
        lattice = self.lattice
        if self.average is not None:
            self.average.put(lattice)
            self.average = None  # as large as the lattice
        keep = lattice.seen(self._largest_weights(), self.config.prune)
        if self.data.has_alpha:
            assert self.capture.alphas is not None
            wrong, loose = ruled_out(
                self.capture.cameras[self.views], [self.capture.alphas[v] for v in self.views],
                keep, lattice.center, lattice.radius)
            lattice = lattice.kept(keep & ~wrong)
            keep = lattice.attached(loose)
        self.lattice = lattice.kept(keep)
        if self.data.has_alpha and not np.allclose(self.gains, 1.0) and len(self.test_gains):
            found = matte_gains(self.field(), self.capture, self.capture.testing(), least=0.0)
            if found is not None:
                self.test_gains = found

    def options(self) -> NDArray[np.float64]:
        """Options of the kernel: step, least density and so on."""
        assert self.lattice is not None
        config = self.config
        # A density that takes less than this of the light in a step is left alone: it teaches
        # nothing, and most samples are of this kind.
        faint = 2e-3 if self.data.has_alpha else 1e-4
        least = faint / (config.step_size * self.lattice.voxel)
        return np.array([config.step_size, least, config.stop_thresh,
                         config.lambda_alpha if self.data.has_alpha else 0.0,
                         config.lambda_sparsity, config.lambda_distortion, 0.0, config.near_clip])

    def _largest_weights(self) -> NDArray[np.float32]:
        """The largest weight of each row on an eighth of the training tiles."""
        assert self.lattice is not None
        # Behind a transmittance of ``prune`` no weight is larger than that: a ray may end there.
        options = self.options()
        options[2] = self.config.prune
        return Caster(self.lattice, self.data, self.basis, self.workers).largest(
            self.data.tiles[self.level % 8::8], self.scale, options)

    # -- optimisation -----------------------------------------------------------------------------

    def _deadline(self) -> float:
        """When the level must end, by the clock of `time.perf_counter`."""
        # Coarse levels end with their rays: what they lack for a slow beginning, while kernels
        # are compiled, no finer level can make good.
        return self._pace(0.5 if self.level < len(self.config.resolutions) - 1 else 0.0)

    def _pace(self, least: float = 0.0) -> float:
        """When the level has had its share of the time, or a share of ``least`` of what is left."""
        config = self.config
        if config.time_budget <= 0:
            return np.inf
        now = time.perf_counter()
        shares = config.shares()
        own = shares[self.level] * (1.0 - self.level_done)
        share = max(least, own / (own + sum(shares[self.level + 1:])))
        faced = self.capture.landmarks is not None and (config.fill_back or config.cut_base)
        whole = config.training_seconds(self.data.has_alpha, faced)
        return now + share * max(1.0, whole - (now - self.began))

    def background_trainer(self, mean_square: NDArray[np.float32] | None = None,
                            ) -> BackgroundTrainer | None:
        """What trains the background, if there is one; goes on from what it remembers."""
        if self.background is None:
            return None
        trainer = BackgroundTrainer(self.background, self.workers, self.config.background)
        if mean_square is not None:
            trainer.mean_square = mean_square
        return trainer

    def new_batches(self) -> Batches:
        """The order of the level's rays, from its beginning."""
        config = self.config
        return Batches(self.data, config.batch[self.level] // 16, config.seed, self.level,
                       config.importance)

    def _train(self) -> float:
        """Train one level; returns the mean squared error of the last steps."""
        assert self.lattice is not None
        config, data, lattice = self.config, self.data, self.lattice
        begun, deadline = time.perf_counter(), self._deadline()
        steps = max(1.0, np.round(config.rays[self.level] * 1e6 / config.batch[self.level]))
        paced = config.paced and self.level < len(config.resolutions) - 1
        until = self._pace() if paced else deadline
        caster = Caster(lattice, data, self.basis, self.workers)
        if self.table is not None:
            caster.table = self.table
        neighbours = lattice.neighbours()
        options = self.options()
        finest = self.level == len(config.resolutions) - 1
        # Without mattes the first, wrong, gradients would clear space for good: until the last
        # level a trace of density stays, which can grow again.
        lowest = np.float32(-config.density_floor / lattice.voxel if data.has_alpha or finest
                            else 2.0 * options[1])
        if self.behind is None:
            self.behind = self.background_trainer()
        behind = self.behind
        batches = self.batches
        if batches is None:
            batches = self.batches = self.new_batches()
        shares = config.shares()
        before, share = sum(shares[:self.level]), shares[self.level]
        resumed = self.level_done
        while self.step < steps or (paced and time.perf_counter() < until):
            generator = batches.generator(0, self.step)
            tiles = batches.step(self.step)
            rays = None
            if behind is not None:
                rays = data.cube_rays(tiles, lattice.center, lattice.radius)
                ground = behind.background.color(rays, config.background)
            elif data.has_alpha:
                ground = np.repeat(np.repeat(generator.random(
                    (len(tiles), 1), np.float32), 3, axis=1), 16, axis=0)
            else:
                ground = np.full((16 * len(tiles), 3), config.background, np.float32)
            if self.step % _LOOK_AGAIN == 0:
                caster.skip_clear(options[1])
                self.table = caster.table
            slopes = caster.cast(tiles, ground, self.scale, options)
            batches.learn(caster.errors)
            now = time.perf_counter()
            # Rates fall by rays or by the clock: a paced level goes by what is behind, others by
            # what is ahead.
            was = self.level_done
            by_clock = resumed + (1.0 - resumed) * (now - begun) / (until - begun)
            self.level_done = min(1.0, (min if paced else max)((self.step + 1) / steps, by_clock))
            done = before + share * self.level_done
            rate = falling(config.lr_sigma, config.lr_sigma_final, done)
            rate_sh = falling(config.lr_sh, config.lr_sh_final, done)
            if data.has_alpha:
                # A step changes the optical depth of a voxel alike, whatever its size.
                rate *= np.float32(config.resolutions[self.level] / 256.0)
            elif self.level == 0:
                rate *= np.float32(min(1.0, 0.01 + self.step / 100.0))
            gains = color_gains(16 * len(tiles), self.basis, self.width)
            descend(lattice.density, lattice.rows.ravel(), self.width, caster.records.arrays,
                    caster.bases, rate, np.float32(config.rms_beta), lowest, gains,
                    np.float32(1.0) / rate_sh)
            smooth_run(lattice, config, self.level, neighbours, float(generator.random()), rate,
                       lowest, gains)
            if behind is not None and rays is not None:
                behind.step(rays, ground, slopes,
                            float(config.lr_color_bg * 0.05 ** done),
                            float(config.lr_sigma_bg * rate / config.lr_sigma))
            if finest and Average.due(was, self.level_done, config.polyak_fraction):
                self.average = self.average or Average(lattice, 3 * self.basis)
                self.average.add(lattice)
            self.step += 1
            self.rays_done += 16 * len(tiles)
            added = caster.losses.sum(axis=0)
            self.recent = 0.98 * self.recent + np.array([added[0], 3 * added[1]])
            self._tell(done)
            if self.poses is not None and self.poses.due(self.level, self.level_done, finest):
                self.place(self.poses.refine(self.field(), self.capture, self.gains))
            if self.lays_mattes and finest and was < _LAY_AGAIN <= self.level_done:
                self.lay_mattes(refined_mattes(self.field(), self.capture))
            if now > deadline:
                break
            self._save_now_and_then()
        return float(self.recent[0] / max(self.recent[1], 1.0))

    def _tell(self, done: float) -> None:
        """Report the progress to the progress line and the meter."""
        assert self.lattice is not None
        resolution = self.config.resolutions[self.level]
        error = float(self.recent[0] / max(self.recent[1], 1.0))
        if self.progress is not None and self.step % 8 == 1:
            self.progress.total = 1000
            self.progress.update(int(1000 * done),
                                 f"{resolution}^3, {self.lattice.count / 1e6:.2f} M voxels, "
                                 f"{-10 * np.log10(max(error, 1e-12)):.1f} dB")
            self.progress.show(self.field)
        if self.meter is not None and self.meter.due():
            self.record()

    def record(self) -> None:
        """Add a point to the curves."""
        assert self.lattice is not None and self.meter is not None
        resolutions = self.config.resolutions
        self.meter.record(self.rays_done, float(self.recent[0] / max(self.recent[1], 1.0)),
                          self.lattice.count, resolutions[min(self.level, len(resolutions) - 1)],
                          self._held_out_psnr)

    def _held_out_psnr(self) -> float | None:
        """PSNR of up to four held-out views at this moment, in dB; None without such views."""
        tests = self.capture.testing()
        if not len(tests):
            return None
        some = np.unique(np.linspace(0, len(tests) - 1, 4).astype(int))
        field, capture = self.field(), self.capture
        if self.poses is not None:
            capture = self.poses.tested(field, capture, self.test_gains, some)
        return held_out_quality(field, capture, self.config.background, self.test_gains,
                                some)["psnr"]
