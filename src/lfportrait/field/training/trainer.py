"""The optimisation itself: one lattice, trained level by level (`field.reconstruction`)."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np

from ...arrays import Float32, Float64, Int32, UInt8
from ...cache import key_of
from ...capture import Capture
from ...device import device_name
from ...errors import UserError
from ...gpu import GpuLostError, GpuProcess
from ...measure import peak_memory_bytes
from ...progress import Progress
from ..background import Background, BackgroundTrainer
from ..config import Settings
from ..geometry.exposure import matte_gains, surface_gains
from ..geometry.head_surface import HeadSurface, find_surface, is_narrow
from ..geometry.mattes import refined_mattes
from ..geometry.start import ruled_out, start_person, start_room
from ..grid import VoxelField
from ..kernels.bricks import row_width
from .checkpoint import deflated, read_checkpoint, write_checkpoint
from .gpu_stepping import fits_gpu, largest_on_gpu, prepare, warn
from .lattice import Average, Lattice, box_shape
from .level import Level
from .meter import Meter, held_out_quality, outlook
from .pixels import IMPORTANCE, Batches, TrainingPixels
from .poses import PoseRefiner
from .stepping import Caster, Steps

INIT_OPACITY = 0.1
"""Initial opacity of a voxel in the visual hull of the mattes."""
STOP = 1e-2
"""Rays stop where their transmittance falls below this."""
LAMBDA_ALPHA, LAMBDA_SPARSITY = 0.3, 0.0
"""Weights of the squared opacity error, for photos with mattes, and of the Cauchy sparsity loss
log(1 + 2 sigma^2) on the samples, which is not used."""
_SAVE_EVERY = 60.0
"""Seconds after which the state is written, which takes one or two: what is lost at most if a
training is interrupted."""
_SHOWN = 96
"""Lattice points to two world units of a level that is good enough for a look; the last level but
one is so in any case."""


class Trainer:
    """The state of one reconstruction."""

    def __init__(self, capture: Capture, config: Settings, progress: Progress | None = None,
                 checkpoint: Path | None = None, meter: Meter | None = None,
                 process: GpuProcess | None = None,
                 look: Callable[[Trainer], None] | None = None) -> None:
        # The GPU's, until it is lost; None: the CPU.
        self.process = process
        if process is not None:
            prepare(process)
        self.original, self.capture, self.config, self.progress = capture, capture, config, progress
        self.checkpoint, self.meter, self.look = checkpoint, meter, look
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
        self.table: Int32 | None = None
        self.recent = np.zeros(2)
        self.average: Average | None = None
        self.steps: Steps | None = None
        self._ready = False
        # Exposures: what photos are divided by; held-out photos have theirs, too.
        self.gains = np.ones((len(self.views), 3))
        self.test_gains = np.ones((len(capture.testing()), 3))
        self.lays_mattes = capture.alphas is not None and config.refines_mattes(
            capture.figures.get("mattes"))
        # Recomputed mattes, deflated, as a checkpoint stores them.
        self.laid: UInt8 | None = None
        self.poses = PoseRefiner(capture, self.views) if config.refine_poses else None
        self.key = key_of(__name__, config, len(self.views),
                          int(self.data.pixels[::997].sum()), self.workers)
        self.began = self._saved = time.perf_counter()
        self._save_took = 0.0
        self.looked = 0.0  # seconds that looks took

    @property
    def scale(self) -> Float32:
        """What the kernel multiplies 8-bit colors of each view with, [V, 3]."""
        return (1.0 / (255.0 * self.gains)).astype(np.float32)

    @property
    def device(self) -> str:
        """What trains, as figures name it: ``"cpu"``, or the GPU."""
        return device_name(None if self.process is None else self.process.adapter)

    # -- state ------------------------------------------------------------------------------------

    def field(self, lattice: Lattice | None = None) -> VoxelField:
        """The field as it is, or of a lattice that was made of its own."""
        self.sync()
        lattice = self.lattice if lattice is None else lattice
        assert lattice is not None
        count = lattice.count
        sh = lattice.rows[:count, :3 * self.basis].reshape(count, 3, self.basis)
        return VoxelField(lattice.links, lattice.density[:count].copy(), np.ascontiguousarray(sh),
                          lattice.center, lattice.radius, self.capture.frame, self.background)

    def sync(self, last: bool = False) -> None:
        """Bring here what the steps of this level have come to; ``last``: of all levels."""
        if self.steps is not None:
            self.steps.sync(last)
            self.average, self.table = self.steps.average, self.steps.table

    @functools.cached_property
    def surface(self) -> HeadSurface | None:
        """Where the person's surface is, if the photos are a narrow arc."""
        return find_surface(self.original) if is_narrow(self.original) else None

    def save(self) -> None:
        """Write the state: between two levels, or in the middle of one."""
        if self.checkpoint is not None and self.lattice is not None:
            start = time.perf_counter()
            self.sync()
            write_checkpoint(self, self.checkpoint)
            self._saved = time.perf_counter()
            self._save_took = self._saved - start

    def save_now_and_then(self) -> None:
        """Save once a minute; less often where writing a state takes over a twentieth of that."""
        if self.checkpoint is not None and (time.perf_counter() - self._saved
                                            >= max(_SAVE_EVERY, 20.0 * self._save_took)):
            self.save()

    def restore(self) -> None:
        """Go on from a checkpoint of the same capture and parameters, if there is one."""
        if self.checkpoint is not None and self.checkpoint.is_file():
            read_checkpoint(self, self.checkpoint)

    def offer(self) -> None:
        """Let whoever wants a look have one, from a level on that is good enough for that."""
        resolutions = self.config.resolutions
        done = resolutions[:self.level]
        if self.look is None or not done or len(done) == len(resolutions) or not (
                done[-1] >= _SHOWN or len(done) == len(resolutions) - 1):
            return
        start = time.perf_counter()
        try:
            self.look(self)
        except BaseException:  # the job ends with the look, and goes on from here
            self.save()
            raise
        took = time.perf_counter() - start
        self.looked += took
        if self.meter is not None:
            self.meter.skip(took)

    # -- levels -----------------------------------------------------------------------------------

    def run_level(self) -> None:
        """Refine the lattice and train it, or go on with what a checkpoint holds.

        If the GPU is lost, the level is left as the last checkpoint has it, or as it began: call it
        again, and it is trained on the CPU.
        """
        config = self.config
        resolution = config.resolutions[self.level]
        begun = time.perf_counter()
        if self.step == 0 and not self._ready:
            if self.lattice is None:
                self._first(resolution)
            else:
                self._refine(resolution)
            assert self.lattice is not None
            # Reset the optimiser's state of each point.
            self.lattice.rows[:, -2:] = 0.0
            self._ready = True
        try:
            error = Level(self).run()
        except GpuLostError as lost:
            self._go_on_without(lost)
            return
        finally:
            if self.steps is not None:
                self.steps.close()
                self.steps = None
        assert self.lattice is not None
        self.log.append({"resolution": resolution, "voxels": self.lattice.count,
                         "train_psnr": round(-10 * float(np.log10(max(error, 1e-12))), 2),
                         "seconds": round(time.perf_counter() - begun, 2)})
        if self.level == 0 and len(config.resolutions) > 1 and self.data.has_alpha:
            self._foretell(begun)
        self.level, self.step, self.level_done, self._ready = self.level + 1, 0, 0.0, False
        self.behind, self.batches, self.table, self.recent = None, None, None, np.zeros(2)
        self.save_now_and_then()

    def _go_on_without(self, lost: GpuLostError) -> None:
        """Leave the GPU, and return to the last checkpoint, or else to the level's beginning."""
        self.process = None
        warn(self.progress, f"{lost}; the training goes on on the CPU")
        self.step, self.level_done, self.recent = 0, 0.0, np.zeros(2)
        self.behind, self.batches, self.table, self.average = None, None, None, None
        lattice, began = self.lattice, self.began
        self.restore()
        self.began = began
        if self.lattice is not lattice:
            self._ready = False

    def _foretell(self, begun: float) -> None:
        """Say what the levels after the first will take."""
        if self.progress is not None and self.lattice is not None:
            self.progress.say(outlook(self.config, time.perf_counter() - begun,
                                      self.lattice.count, self.lays_mattes, peak_memory_bytes()))

    def _first(self, resolution: int) -> None:
        """The lattice to start from."""
        if self.data.has_alpha:
            start = start_person(self.capture, self.views, resolution, self.width,
                                 INIT_OPACITY, self.surface)
        else:
            start = start_room(self.capture, self.views, self.data, self.config, resolution,
                               self.width)
            if start.haze:
                # Rays see through most of the cube at first, and the density must grow slowly:
                # wrong matter near the cameras would hide the rest.
                self.config = replace(self.config, lr_sigma=min(self.config.lr_sigma, 0.3))
        self.lattice, self.background = start.lattice, start.background
        self.gains, self.test_gains = start.gains, start.test_gains
        if self.surface is not None and self.config.exposure:
            found = surface_gains(self.surface, self.capture, self.views, self.capture.testing())
            if found is not None:
                self.gains, self.test_gains = found

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

    def lay_mattes(self, mattes: list[UInt8]) -> None:
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
        if self.average is not None:
            self.average.put(self.lattice)
            self.average = None  # as large as the lattice
        self.lattice = self.cleaned()
        if self.data.has_alpha and not np.allclose(self.gains, 1.0) and len(self.test_gains):
            found = matte_gains(self.field(), self.capture, self.capture.testing(), least=0.0)
            if found is not None:
                self.test_gains = found

    def cleaned(self) -> Lattice:
        """The lattice without points that no ray sees or mattes rule out, and without floaters."""
        self.sync()
        lattice = self.lattice
        assert lattice is not None
        keep = lattice.seen(self._largest_weights(), self.config.prune)
        if self.data.has_alpha:
            assert self.capture.alphas is not None
            wrong, loose = ruled_out(
                self.capture.cameras[self.views], [self.capture.alphas[v] for v in self.views],
                keep, lattice.center, lattice.radius)
            keep &= ~wrong
            keep &= lattice.attached(loose, keep)
        return lattice.kept(keep)

    def options(self) -> Float64:
        """Options of the kernel: step, least density and so on."""
        assert self.lattice is not None
        config = self.config
        # A density that takes less than this of the light in a step is left alone: it teaches
        # nothing, and most samples are of this kind.
        faint = 2e-3 if self.data.has_alpha else 1e-4
        least = faint / (config.step_size * self.lattice.voxel)
        return np.array([config.step_size, least, STOP,
                         LAMBDA_ALPHA if self.data.has_alpha else 0.0,
                         LAMBDA_SPARSITY, config.lambda_distortion, 0.0, config.near_clip])

    def _largest_weights(self) -> Float32:
        """The largest weight of each row on an eighth of the training tiles."""
        assert self.lattice is not None
        # Behind a transmittance of ``prune`` no weight is larger than that: a ray may end there.
        options = self.options()
        options[2] = self.config.prune
        tiles = self.data.tiles[self.level % 8::8]
        if self.process is not None and fits_gpu(self.lattice):
            try:
                return largest_on_gpu(self.process, self.lattice, self.data, tiles, self.scale,
                                      options)
            except GpuLostError as lost:
                self.process = None
                warn(self.progress, f"{lost}; the training goes on on the CPU")
        return Caster(self.lattice, self.data, self.basis, self.workers).largest(
            tiles, self.scale, options)

    # -- optimisation -----------------------------------------------------------------------------

    def deadline(self) -> float:
        """When the level must end, by the clock of `time.perf_counter`."""
        # Coarse levels end with their rays: what they lack for a slow beginning, while kernels
        # are compiled, no finer level can make good.
        return self.pace(0.5 if self.level < len(self.config.resolutions) - 1 else 0.0)

    def pace(self, least: float = 0.0) -> float:
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

    def background_trainer(self, mean_square: Float32 | None = None) -> BackgroundTrainer | None:
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
                       IMPORTANCE)

    def tell(self, done: float) -> None:
        """Report the progress to the progress line and the meter, and offer a look."""
        assert self.lattice is not None
        resolution = self.config.resolutions[self.level]
        error = float(self.recent[0] / max(self.recent[1], 1.0))
        if self.progress is not None and self.step % 8 == 1:
            self.progress.total = 1000
            self.progress.update(int(1000 * done),
                                 f"{resolution}^3, {self.lattice.count / 1e6:.2f} M voxels, "
                                 f"{-10 * np.log10(max(error, 1e-12)):.1f} dB")
            self.progress.show(self.field)
        if self.step % 8 == 1:
            self.offer()
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
