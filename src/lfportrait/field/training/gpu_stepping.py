"""Steps of a level on a GPU: planned here, taken by the device's process many at a time."""

import contextlib
import threading
import time
import warnings
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np

from ...arrays import Array, Float32, Float64, Int32, UInt32
from ...gpu import GpuProcess
from ...progress import Progress
from ..background import BackgroundTrainer
from ..gpu.training import STEP
from ..kernels.bricks import put_means
from .lattice import Average, Lattice
from .pixels import TrainingPixels
from .stepping import DECAY, Plan, StepData, color_gains, variation_of

_CALLS = "lfportrait.field.gpu.training"
_TOGETHER, _FIRST = 64, 4  # Steps of a call at most, and of the first one.
_LONG = 0.2
"""Seconds that a call should take at most, so that clocks are kept on slow devices, too."""


def tiles_given(data: TrainingPixels, tiles: Int32, greys: Float32) -> UInt32:
    """Tiles with their pixels as the GPU takes them: uint32 [T, 20].

    View, row, column, the grey's bits as a float32, and 16 pixels of four bytes; pixels beyond a
    picture's edge are the last ones before it.
    """
    out = np.empty((len(tiles), 20), np.uint32)
    out[:, :3] = tiles
    out[:, 3] = greys.view(np.uint32)
    sizes = data.sizes[tiles[:, 0]]
    inner = np.arange(16)
    x = np.minimum(tiles[:, 2, None] + (inner & 3), sizes[:, :1] - 1)
    y = np.minimum(tiles[:, 1, None] + (inner >> 2), sizes[:, 1:] - 1)
    places = data.starts[tiles[:, 0], None] + y * sizes[:, :1] + x
    out[:, 4:] = data.pixels.view(np.uint32)[:, 0][places]
    return out


def cameras_given(data: TrainingPixels, geometry: Float64, scale: Float32) -> Float32:
    """Cameras as the GPU takes them: float32 [V, 32].

    Origin in lattice coordinates, rotation row by row, the lattice's scale, focal lengths and
    principal point, width and height, and what 8-bit colors are multiplied with.
    """
    cameras = data.cameras
    out = np.zeros((len(cameras), 32), np.float32)
    out[:, 0:3] = cameras[:, [3, 7, 11]] * geometry[3:6] + geometry[6:9]
    out[:, 4:13] = cameras[:, [0, 1, 2, 4, 5, 6, 8, 9, 10]]
    out[:, 13:16] = geometry[3:6]
    out[:, 16:20] = cameras[:, 12:16]
    out[:, 20:22] = data.sizes
    out[:, 22:25] = scale
    return out


def level_given(lattice: Lattice, geometry: tuple[Any, ...], cameras: Float32,
                pace: float) -> dict[str, Any]:
    """A lattice and its cameras as the GPU takes them, without what is trained."""
    table, links, _ = geometry
    return {"table": table, "links": links, "density": lattice.density,
            "shape": lattice.links.shape, "cameras": cameras, "pace": pace}


def fits_gpu(lattice: Lattice) -> bool:
    """Whether the shaders can cast rays through a lattice: points have ten bits a side."""
    return max(lattice.links.shape) < 1024


def prepare(process: GpuProcess) -> None:
    """Start the device's process and compile its kernels, beside what is done here meanwhile."""
    def run() -> None:
        # Whoever asks next hears of it.
        with contextlib.suppress(Exception):
            process.call(f"{_CALLS}:prepare")

    threading.Thread(target=run, daemon=True).start()


def warn(progress: Progress | None, line: str) -> None:
    """Say a line where there is a progress line, else by Python's warnings."""
    if progress is not None:
        progress.say(line)
    else:
        warnings.warn(line, stacklevel=3)


def ray_numbers(options: Float64) -> Array:
    """`STEP` [1] with the options of `lfportrait.field.kernels.train.make_cast` put in."""
    steps = np.zeros(1, STEP)
    for name, value in zip(("pace", "threshold", "stop", "alpha_weight", "narrow"), options,
                           strict=False):
        steps[name] = value
    steps["near"] = options[6]
    return steps


def largest_on_gpu(process: GpuProcess, lattice: Lattice, data: TrainingPixels, tiles: Int32,
                   scale: Float32, options: Float64) -> Float32:
    """The largest weight of each row on the rays of tiles, as `Caster.largest`: float32 [N + 1]."""
    geometry = lattice.geometry()
    given = level_given(lattice, geometry, cameras_given(data, geometry[2], scale),
                        float(options[0]))
    inputs = tiles_given(data, np.ascontiguousarray(tiles), np.zeros(len(tiles), np.float32))
    return np.asarray(process.call(f"{_CALLS}:largest", given, ray_numbers(options), inputs))


class GpuSteps:
    """Steps on a GPU.

    While the device works on some steps, the next ones are planned here. Until `sync` the lattice
    here is the one that the level began with. Raises `GpuLostError` from every method, if the
    device is lost or too small.

    Parameters
    ----------
    level : What is trained; records are taken up in the order of ``level.workers`` threads.
    tiles : Packets of each step.
    behind : What trains the spheres behind the lattice, if there are any.
    average : Sums to go on with.
    table : Table of bricks to go on with, by `look_again`.
    """

    def __init__(self, process: GpuProcess, level: StepData, tiles: int,
                 behind: BackgroundTrainer | None = None, average: Average | None = None,
                 table: Int32 | None = None) -> None:
        lattice, data, config, scale = level.lattice, level.data, level.config, level.scale
        self.behind = behind
        self.process, self.lattice, self.data, self.scale = process, lattice, data, scale
        self.taken, self.average, self.basis = level.taken, average, level.basis
        geometry = lattice.geometry()
        self._geometry = geometry[2]
        weights, tv_scale, run = variation_of(config, level.number, lattice.count)
        self._run, self._states = run, average.count if average is not None else 0
        base = ray_numbers(level.options)
        base["decay"], base["lowest"], base["workers"] = DECAY, level.lowest, level.workers
        base["tv_weight"], base["tv_color"] = weights[0] / run, weights[1] / run
        base["tv_scale"] = tv_scale
        base["gain"] = color_gains(16 * tiles, 1, 16)[0] / 0.7
        shells = None
        if behind is not None:
            sphere = behind.background
            shells = {"links": sphere.links, "data": sphere.data,
                      "mean_square": behind.mean_square}
            base["layers"], base["high"] = sphere.layers, sphere.links.shape[1]
            base["grey"] = config.background
        self._base = base
        self.table = table
        self._looks_next, self._looked = False, False
        self._waiting: list[tuple[Plan, bool]] = []
        self._under_way: tuple[list[Plan], Future[tuple[Float32, float]]] | None = None
        self._together = _FIRST
        self._thread = ThreadPoolExecutor(1)
        self._call("begin", {
            **level_given(lattice, geometry, cameras_given(data, geometry[2], scale()),
                          float(level.options[0])),
            "rows": lattice.rows, "neighbours": lattice.neighbours(), "basis": level.basis,
            "tiles": tiles, "run": run, "smooths_colors": config.lambda_tv_sh > 0,
            "bright": table, "shells": shells})
        process.note(_CALLS, ("level",))
        if average is not None:
            self._call("put_average", average.density, average.rows)

    def _call(self, name: str, *arguments: Any) -> Any:
        return self.process.call(f"{_CALLS}:{name}", *arguments)

    def take(self, plan: Plan) -> None:
        """Let a step wait; with enough of them, send them off."""
        self._waiting.append((plan, self._looks_next))
        self._looked |= self._looks_next
        self._looks_next = False
        if len(self._waiting) >= self._together:
            self._send()

    def _timed(self, *arguments: Any) -> tuple[Float32, float]:
        """Errors of some steps, and the seconds that they took."""
        start = time.perf_counter()
        return self._call("take", *arguments), time.perf_counter() - start

    def _send(self) -> None:
        """Send off what waits, and take in what was sent off before."""
        waiting, self._waiting = self._waiting, []
        plans = [plan for plan, _ in waiting]
        arguments = (*self._given(plans), np.array([looks for _, looks in waiting]))
        before, self._under_way = self._under_way, None
        # What is under way must be done before the process is called again.
        found = before[1].result() if before is not None else None
        if plans:
            self._under_way = plans, self._thread.submit(self._timed, *arguments)
        if before is not None and found is not None:
            share = _LONG * len(before[0]) / max(found[1], 1e-6)
            self._together = int(np.clip(share, 1, min(_TOGETHER, 2 * self._together)))
            for plan, errors in zip(before[0], found[0], strict=True):
                self._states += plan.averaged
                self.taken(plan, errors, float(errors.sum(dtype=np.float64)))

    def _given(self, plans: list[Plan]) -> tuple[Array, ...]:
        """Steps as the device's process takes them."""
        if not plans:
            return ()
        steps = np.repeat(self._base, len(plans))
        first = np.array([int(plan.place * self.lattice.count) for plan in plans])
        steps["rate"] = [plan.rate for plan in plans]
        steps["memory"] = [np.float32(1.0) / plan.rate_sh for plan in plans]
        steps["tv_first"] = first
        steps["rate_shell"] = [plan.background_rates[0] for plan in plans]
        steps["rate_shell_density"] = [plan.background_rates[1] for plan in plans]
        steps["tv_last"] = np.minimum(self.lattice.count, first + self._run)
        inputs = tiles_given(self.data, np.concatenate([plan.tiles for plan in plans]),
                             np.concatenate([plan.greys for plan in plans]))
        return (steps, inputs.reshape(len(plans), -1, 20),
                np.array([plan.averaged for plan in plans]))

    def flush(self) -> None:
        """Take the steps that wait."""
        while self._waiting or self._under_way is not None:
            self._send()

    def measure(self, plan: Plan, repeats: int) -> dict[str, Any]:
        """What a step's kernels take on the device; the level there is of no use afterwards."""
        self.flush()
        steps, inputs, _ = self._given([plan])
        return dict(self._call("measure", steps, inputs, repeats))

    def look_again(self, least: float) -> None:
        """Let rays leap over bricks in which no density is above ``least``, from the next step on.

        It is the threshold of the options.
        """
        self._looks_next = True

    def place(self) -> None:
        """The pixels' cameras have changed."""
        self.flush()
        self._call("place", cameras_given(self.data, self._geometry, self.scale()))

    def sync(self, last: bool = False) -> None:
        """Bring the lattice's values here, and the average's.

        ``last``: the training is over. Where there is an average, the lattice gets that alone.
        """
        self.flush()
        lattice = self.lattice
        if self.behind is not None:
            data, square = self._call("fetch_shells")
            self.behind.background.data[:] = data.reshape(self.behind.background.data.shape)
            self.behind.mean_square[:] = square
        if self._looked:
            self.table = self._call("fetch_table")
        if last and self._states:
            self._bring(lattice.density, lattice.rows, self._states)
            # The mean is in the lattice: the sums are as large, and of no use any more.
            self.average = None
            return
        if self._states:
            self.average = self.average or Average(lattice, 3 * self.basis)
            self._bring(self.average.density, self.average.rows, sums=True)
            self.average.count = self._states
        lattice.rows[:, -2:] = self._bring(lattice.density, lattice.rows)

    def _bring(self, density: Float32, rows: Float32,
               states: int = 0, sums: bool = False) -> Float32 | None:
        """Write what the device has into densities [N + 1] and the colors of rows.

        The lattice's values, the mean of ``states`` of them, or their sums. Returns what the
        optimiser remembers of the rows, float32 [N + 1, 2]; None with states or sums.
        """
        found, pages, remembered = self._call("fetch", sums or states > 0)
        np.divide(found, np.float32(max(states, 1)), out=density)
        first = 0
        for page in pages:
            put_means(page, 3 * self.basis, np.float32(max(states, 1)), rows, first)
            first += len(page)
        return remembered

    def close(self) -> None:
        """Forget the level; steps that wait are not taken."""
        self._thread.shutdown(wait=True)
        if self.process.holds(_CALLS, "level"):
            self.process.note(_CALLS, ())
            self._call("end")
