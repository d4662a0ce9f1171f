"""The optimisation itself: one lattice, trained level by level (`field.reconstruction`).

Its state is kept as a checkpoint, from which a training goes on that was interrupted.

Where a head is closed, guessed matter meets what photos saw: it hides a shoulder that they saw
slantingly, or ends in another color than theirs. Photos know better wherever they see it. So the
closed lattice is trained for a while as the last level was, at its final rates (`settled`): what a
ray meets is made right, total variation carries colors across the border, and what no ray meets
stays. Where it is known what was added, only the parts of the photos that show that are asked: with
as many rays these are looked at more than twice as often, and a face stays as it was.
"""

from __future__ import annotations

import functools
import time
import zlib
from collections.abc import Callable, Sequence
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
from ...files import UNREADABLE_ARRAYS, atomic_write
from ...gpu import GpuLostError, GpuProcess
from ...measure import peak_memory_bytes
from ...progress import Progress
from ..background import Background, BackgroundTrainer
from ..config import Settings
from ..geometry.clean_plates import WIDEST
from ..geometry.exposure import matte_gains, surface_gains
from ..geometry.head_surface import HeadSurface, find_surface, is_narrow
from ..geometry.mattes import refined_mattes
from ..geometry.start import ruled_out, start_person, start_room
from ..grid import VoxelField
from ..kernels.bricks import row_width
from .gpu_stepping import GpuSteps, fits_gpu, largest_on_gpu, prepare, warn
from .lattice import Average, Lattice, box_shape
from .meter import Meter, held_out_quality, outlook
from .pixels import IMPORTANCE, Batches, TrainingPixels
from .poses import PoseRefiner
from .stepping import Caster, CpuSteps, Plan, StepData, Steps, falling

INIT_OPACITY = 0.1  # Initial opacity of a voxel in the visual hull of the mattes.
STOP = 1e-2  # Rays stop where their transmittance falls below this.
LAMBDA_ALPHA = 0.3  # Weight of the squared opacity error, for photos with mattes.
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
            _write_checkpoint(self, self.checkpoint)
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
            _read_checkpoint(self, self.checkpoint)

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
                self.lay_mattes(self.refined_mattes(field))
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

    def refined_mattes(self, field: VoxelField) -> list[UInt8]:
        """Mattes of all views from a field (`geometry.mattes.refined_mattes`)."""
        # Those of an arc know what is behind the person.
        plates = (self.surface is not None and self.surface.span <= WIDEST
                  and self.original.figures.get("mattes") == "network")
        return refined_mattes(field, self.capture, self.original.alphas if plates else None)

    def lay_mattes(self, mattes: list[UInt8]) -> None:
        """Go on with these mattes of all views."""
        self.capture = replace(self.capture, alphas=mattes)
        self.data.lay_mattes([mattes[view] for view in self.views])
        self.laid = _deflated(mattes)

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
        """Options of the kernel, float64 [7]: step, least density and so on (`kernels.train`)."""
        assert self.lattice is not None
        config = self.config
        # A density that takes less than this of the light in a step is left alone: it teaches
        # nothing, and most samples are of this kind.
        faint = 2e-3 if self.data.has_alpha else 1e-4
        least = faint / (config.step_size * self.lattice.voxel)
        return np.array([config.step_size, least, STOP,
                         LAMBDA_ALPHA if self.data.has_alpha else 0.0,
                         config.lambda_distortion, 0.0, config.near_clip])

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


def _deflated(mattes: list[UInt8]) -> UInt8:
    """Mattes as they are kept: a hundredth of their size."""
    return np.frombuffer(zlib.compress(b"".join(map(np.ndarray.tobytes, mattes)), 1), np.uint8)


def _inflated(data: UInt8, like: Sequence[UInt8]) -> list[UInt8]:
    """The mattes again; ``like`` has their shapes."""
    flat = np.frombuffer(zlib.decompress(data.tobytes()), np.uint8)
    ends = np.cumsum([matte.size for matte in like])
    return [part.reshape(matte.shape)
            for part, matte in zip(np.split(flat, ends[:-1]), like, strict=True)]


def _write_checkpoint(trainer: Trainer, path: Path) -> None:
    """Write the state that the rest of the training depends on."""
    lattice = trainer.lattice
    assert lattice is not None
    state: dict[str, Any] = {
        "key": trainer.key,
        "counts": np.array([trainer.level, trainer.step, trainer.rays_done]),
        "elapsed": time.perf_counter() - trainer.began, "links": lattice.links,
        "density": lattice.density, "rows": lattice.rows, "center": lattice.center,
        "radius": lattice.radius, "gains": trainer.gains, "test_gains": trainer.test_gains,
        "recent": trainer.recent,
        "rates": np.array([trainer.level_done, trainer.config.lr_sigma])}
    if trainer.poses is not None:
        state.update(trainer.poses.state())
    if trainer.background is not None:
        state["background_links"] = trainer.background.links
        state["background_data"] = trainer.background.data
        if trainer.behind is not None:
            state["background_mean_square"] = trainer.behind.mean_square
    if trainer.batches is not None:
        state |= trainer.batches.state
    if trainer.average is not None:
        state |= trainer.average.state
    if trainer.laid is not None:
        state["mattes"] = trainer.laid
    if trainer.table is not None:
        state["table"] = trainer.table
    with atomic_write(path) as stream:
        np.savez(stream, **state)


def _read_checkpoint(trainer: Trainer, path: Path) -> None:
    """Load a checkpoint of the same capture and parameters; others are ignored."""
    try:
        with np.load(path, allow_pickle=False) as data:
            if str(data["key"]) != trainer.key:
                return
            state = {name: data[name] for name in data.files}
        level, step, rays = (int(count) for count in state["counts"])
        lattice = Lattice(state["links"], state["density"], state["rows"], state["center"],
                          state["radius"])
        average = Average.restored(state, lattice)
        gains, test_gains, recent = state["gains"], state["test_gains"], state["recent"]
        elapsed = float(state["elapsed"])
        level_done, lr_sigma = (float(number) for number in state["rates"])
        capture = (trainer.capture if trainer.poses is None
                   else trainer.poses.restore(state, trainer.capture))
        mattes = None
        if "mattes" in state:
            assert capture.alphas is not None
            mattes = _inflated(state["mattes"], capture.alphas)
    except UNREADABLE_ARRAYS:
        return
    trainer.level, trainer.step, trainer.rays_done, trainer.lattice = level, step, rays, lattice
    trainer.gains, trainer.test_gains, trainer.recent = gains, test_gains, recent
    trainer.level_done, trainer.table = level_done, state.get("table")
    trainer.average = average
    trainer.place(capture)
    if mattes is not None:
        trainer.lay_mattes(mattes)
    trainer.began -= elapsed
    trainer.config = replace(trainer.config, lr_sigma=lr_sigma)
    if "background_links" in state:
        trainer.background = Background(state["background_links"], state["background_data"])
    if "background_mean_square" in state:
        trainer.behind = trainer.background_trainer(state["background_mean_square"])
    if "batch_part" in state:
        trainer.batches = trainer.new_batches()
        trainer.batches.restore(state)


LR_SH = 2.5
"""Learning rate of the colors at the start: 1 / N, if a color is the running mean over N rays.
(Colors step as in SART, not by RMSProp as in svox2.)"""
LR_SIGMA_BG, LR_COLOR_BG = 3.0, 0.1
"""Learning rates of the background's density and color at the start, those of svox2; the first
falls like the density's, the second to a twentieth."""
_LOOK_AGAIN = 400  # Steps after which it is looked again for bricks that have become clear.
_LAY_AGAIN = 0.4
"""Share of the finest level after which mattes are recomputed: its outline is finer by then."""


class Level:
    """The level that a trainer is at, whose state is up to date after each step."""

    def __init__(self, trainer: Trainer) -> None:
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
        level = StepData(trainer.lattice, trainer.data, trainer.config, trainer.level,
                         trainer.basis, trainer.workers, self.options, self.lowest,
                         lambda: trainer.scale, self._taken)
        if trainer.process is not None and not fits_gpu(trainer.lattice):
            trainer.process = None
            warn(trainer.progress, "a lattice of more than 1023 points a side is trained on the "
                 "CPU")
        if trainer.process is not None:
            return GpuSteps(trainer.process, level, tiles=self.batches.size,
                            behind=trainer.behind, average=trainer.average, table=trainer.table)
        steps = CpuSteps(level)
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
            trainer.lay_mattes(trainer.refined_mattes(trainer.field()))


_SHARE = 0.25
"""Rays that are cast, over those of the last level: usually three millions. Held-out views gain
0.9 dB by the first, 0.3 by each of the next two, and 0.1 by the fourth."""
_SHARE_OF_NEW = 0.4
"""The same where only what is new is asked: half of it costs outlines 0.2 dB before a full wall."""
_PASSES = 8.0  # Times that each tile is asked at most where only some are, usually less than once.
_STILL = 16
"""Steps at first in which densities stay: a step is as long as the slopes before it allow."""
_AVERAGED = 0.5  # Share of the steps, at the end, whose states are averaged.


def settled(trainer: Trainer, field: VoxelField, share: float | None = None,
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
    steps = CpuSteps(StepData(
        lattice, trainer.data, config, level, trainer.basis, trainer.workers, trainer.options(),
        np.float32(-config.density_floor / lattice.voxel), lambda: trainer.scale,
        lambda plan, errors, _: batches.learn(errors, plan.blocks)))
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
