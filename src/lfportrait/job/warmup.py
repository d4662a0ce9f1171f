"""Compile kernels ahead of their use, in separate processes, on all cores.

Numba compiles a kernel when it is first called, for seconds. So each stage is run once on next to
nothing in another process, which leaves the compiled code in Numba's cache on the disk: a grey ball
with a face's landmarks is photographed by hand from a few sides, in a few pixels; a few colored
squares with the same landmarks are its painting.

There are as many of these processes as cores; each takes the next stage that nobody has taken, so
that what all stages need is imported once a process. The job waits for a stage's code where it is
needed. A mark beside the cache records that a stage's code is there: the next run starts no
process.
"""

from __future__ import annotations

import functools
import gc
import importlib
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Float64
from ..cache import hash_of
from ..capture import Camera, Capture
from ..example import Exemplar
from ..field import VoxelField
from ..measure import usable_cores
from ..progress import Progress, note
from ..runner import Child, Pipe
from ..temporary import temporary_folder

FUNCTIONS = {"mattes": 14, "transfer": 44, "reconstruct": 67, "stylize": 43, "encode": 38}
"""Functions that each stage compiles after those before it: a few more or less on other
processors."""


def _mattes() -> None:
    from .prepare import cut_person

    for arc in (14.0, 115.0):  # with what is behind the person, and by votes
        capture = ball_capture(size=96, arc=arc)
        assert capture.alphas is not None
        cut_person(replace(capture, alphas=None),
                   soft=[np.asarray(matte / 255.0, np.float32) for matte in capture.alphas])


def _reconstruct() -> None:
    from ..field import ReconstructConfig, reconstruct
    from ..field.geometry import find_surface

    find_surface(ball_capture(size=96, arc=14.0))  # what a narrow arc starts from
    reconstruct(ball_capture(), ReconstructConfig(
        resolutions=(16, 32), rays=(0.004, 0.01), batch=(1024,)), device="cpu")


def _transfer() -> None:
    import numpy as np

    from ..example import SurfaceGuide, Transfer

    capture, exemplar = ball_capture(size=192), drawn_exemplar(192, 256)
    assert capture.landmarks is not None and capture.alphas is not None
    transfer = Transfer(exemplar)
    guide = SurfaceGuide(capture.landmarks, exemplar, transfer.regions)
    view = len(capture) // 2
    position, anchor = guide(ball_points(capture.cameras, view))
    photo, mask = (np.asarray(picture / 255.0, np.float32)
                   for picture in (capture.images[view], capture.alphas[view]))
    transfer.apply(photo, capture.cameras.project(capture.landmarks)[0][view], position=position,
                   seeds_anchor=anchor, mask=mask)


def _stylize() -> None:
    from ..stylize import rehearse

    rehearse(ball_field(9), ball_capture())


def _encode() -> None:
    from ..lightfield import Display, EncodeConfig, ViewMask, encode, quilt_of, simulate
    from ..share import sweep_cameras, write_page

    display = Display(48, 24, views=6, pitch=5.3, slant=math.radians(10), quilt=(3, 2),
                      quilt_size=(48, 32))
    field = ball_field(1)
    config = EncodeConfig(ground="white")
    image = encode(field, display, config, mask=ViewMask.build(display))
    simulate(image, display, (0.1,))
    quilt_of(field, display, config)
    # What the report shows from far aside.
    aside = sweep_cameras(120.0, 4, 16)
    field.render(aside, 1)
    field.depth(aside, 1)
    with temporary_folder() as folder:
        write_page(field, folder / "portrait.html")


_STAGES: dict[str, Callable[[], None]] = {
    "mattes": _mattes, "reconstruct": _reconstruct, "transfer": _transfer, "stylize": _stylize,
    "encode": _encode}


def run_stage(name: str, announce: Callable[[str], None] = print) -> None:
    """Compile a stage's functions in this process; ``announce`` is called with the name of each."""
    from ..simd.host import watched_compilations

    with watched_compilations(announce):
        _STAGES[name]()


def serve() -> None:
    """Compile the stages that are asked for; what is said without a name ends each one's."""
    pipe = Pipe()
    gc.disable()  # to look for garbage while Numba compiles takes a sixth of its time
    while True:
        run_stage(pipe.requests.get(), pipe.tell)
        gc.collect()
        pipe.tell()


@functools.cache
def _mark(name: str) -> Path:
    """The file that stands for a stage's compiled code, beside that code.

    It knows which instructions are used: code for fewer of them is another (`LFPORTRAIT_VECTORS`).
    """
    import llvmlite.binding
    import numba

    from ..simd.decorators import kernel_sources
    from ..simd.host import cache_folder

    settings: Any = numba.config
    key = hash_of(name, kernel_sources(), numba.__version__, sys.version,
                 llvmlite.binding.get_host_cpu_name(),
                 str(llvmlite.binding.get_host_cpu_features()),
                 settings.CPU_NAME, settings.CPU_FEATURES)
    return cache_folder() / f"warm-{name}-{key[:16]}"


def head_kernels(fitted: bool, matted: bool = True) -> tuple[str, ...]:
    """The stages of a job, as `FUNCTIONS` has them; a head that is ``fitted`` is not trained.

    Photos that are not ``matted`` are yet to be cut out: that comes first, and nobody waits for it.
    """
    stages = ("reconstruct", "transfer", "stylize", "encode")[fitted:]
    return stages if matted or fitted else ("mattes", *stages)


def import_ahead(name: str) -> None:
    """Import a module in the background: while photos are read and placed, a core is idle."""
    def work() -> None:
        with suppress(ImportError):  # whoever needs it says so
            importlib.import_module(name)

    threading.Thread(target=work, daemon=True).start()


class Warmup:
    """Stages of `FUNCTIONS` being compiled in the background, those first that are needed first.

    Those that an earlier run compiled are not compiled again. ``compiled`` functions of about
    ``total`` are done so far.
    """

    def __init__(self, names: Sequence[str]) -> None:
        wanted = [name for name in names if not _mark(name).exists()]
        if wanted:
            from ..simd.host import sweep_kernels

            sweep_kernels()
        self.compiled = 0
        self.total = sum(FUNCTIONS[name] for name in wanted)
        self._lock = threading.Lock()
        self._waiting = wanted
        self._done = {name: threading.Event() for name in wanted}
        self._children: list[Child] = []
        self._threads = [threading.Thread(target=self._work, daemon=True)
                         for _ in range(min(usable_cores(), len(wanted)))]
        for thread in self._threads:
            thread.start()

    def _work(self) -> None:
        """Compile stage after stage in one process; what fails is left to the job."""
        child = None
        while True:
            with self._lock:
                if not self._waiting:
                    break
                name = self._waiting.pop(0)
            child = child or self._start()
            try:
                child.send(name)
                while child.receive():
                    self.compiled += 1
                _mark(name).parent.mkdir(parents=True, exist_ok=True)
                _mark(name).touch()
            except (OSError, EOFError):  # it ended before the stage did
                child.close()
                child = None
            self._done[name].set()
        if child is not None:
            child.close()

    def _start(self) -> Child:
        """A process that compiles stages."""
        # One thread is enough for specimens, and leaves the cores to the compilers.
        child = Child("lfportrait.job.warmup:serve", Path(os.devnull),
                      {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"})
        with self._lock:
            self._children.append(child)
        return child

    def ready(self, names: Sequence[str]) -> bool:
        """Whether the kernels of stages are compiled."""
        return all(name not in self._done or self._done[name].is_set() for name in names)

    @property
    def left(self) -> int:
        """Functions that are still to be compiled, about."""
        return 0 if self.ready(tuple(self._done)) else max(1, self.total - self.compiled)

    def wait(self, names: Sequence[str], progress: Progress | None = None) -> None:
        """Return when the kernels of stages are compiled; shows the state on ``progress``."""
        for name in names:
            done = self._done.get(name)
            while done is not None and not done.wait(0.1):
                note(progress, f"compiling kernels, once: {self.compiled} of "
                               f"{max(self.total, self.compiled)}")

    def close(self) -> None:
        """End what is still being compiled."""
        with self._lock:
            self._waiting.clear()
        # A thread that had taken a stage may be about to start its process.
        while any(thread.is_alive() for thread in self._threads):
            with self._lock:
                for child in self._children:
                    child.kill()
            time.sleep(0.01)

    def __enter__(self) -> Warmup:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


_RADIUS = 0.6


def _face() -> Float64:
    """68 landmarks of a frontal face, [68, 2]: x right, y down, the face about 2 high."""
    def arc(count: int, x: float, y: float, rx: float, ry: float, start: float, end: float,
            ) -> Float64:
        angle = np.radians(np.linspace(start, end, count))
        return np.stack([x + rx * np.cos(angle), y + ry * np.sin(angle)], axis=1)

    def line(count: int, x0: float, y0: float, x1: float, y1: float) -> Float64:
        return np.stack([np.linspace(x0, x1, count), np.linspace(y0, y1, count)], axis=1)

    eyes = [arc(7, side * 0.28, -0.17, 0.11, 0.05, 180, 540)[:6] for side in (-1, 1)]
    return np.concatenate([
        arc(17, 0, -0.15, 0.62, 1.0, 175, 5), line(5, -0.47, -0.32, -0.12, -0.35),
        line(5, 0.12, -0.35, 0.47, -0.32), line(4, 0, -0.18, 0, 0.15),
        line(5, -0.13, 0.21, 0.13, 0.22), *eyes, arc(13, 0, 0.47, 0.24, 0.1, 180, 540)[:12],
        arc(9, 0, 0.47, 0.17, 0.03, 180, 540)[:8]])


def ball_points(cameras: Camera, view: int) -> Float64:
    """Where each pixel's ray meets the ball: float64 [H, W, 3], NaN where it does not."""
    origins, directions = cameras.rays(view)
    half = (origins * directions).sum(-1)
    root = half ** 2 - (origins ** 2).sum(-1) + _RADIUS ** 2
    along = np.where(root > 0, -half - np.sqrt(np.maximum(root, 0)), np.nan)
    points = origins + along[:, None] * directions
    return points.reshape(int(cameras.height[view]), int(cameras.width[view]), 3)


def ball_capture(size: int = 32, arc: float = 115.0) -> Capture:
    """16 photos of a speckled ball, from -``arc`` to ``arc`` degrees; landmarks on its front."""
    cameras = Camera.arc(np.linspace(-arc, arc, 16), distance=4.0, width=size, height=size,
                         focal=1.7 * size)
    images, alphas = [], []
    for view in range(len(cameras)):
        points = ball_points(cameras, view)
        speckles = 130 + 60 * np.sin(7 * points @ np.array([1.0, 1.7, 0.6]))
        images.append(np.repeat(np.nan_to_num(speckles, nan=20.0)[..., None], 3, 2
                                ).astype(np.uint8))
        alphas.append(np.where(np.isfinite(speckles), 255, 0).astype(np.uint8))
    face = _face()
    x, y = 1.5 * _RADIUS * face[:, 0], -0.7 * _RADIUS * (face[:, 1] + 0.3)
    z = np.sqrt(np.maximum(_RADIUS ** 2 - x ** 2 - y ** 2, 0.0))
    return Capture(cameras, images, alphas, [f"{view}.png" for view in range(len(images))],
                   np.zeros(len(images), bool), landmarks=np.stack([x, y, z], axis=1))


def ball_field(basis: int, size: int = 20) -> VoxelField:
    """The ball as a field with ``basis`` coefficients a channel."""
    axis = 2.0 * (np.arange(size) + 0.5) / size - 1.0
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    filled = np.abs(np.sqrt(x * x + y * y + z * z) - _RADIUS) < 3.0 / size
    links = np.full((size, size, size), -1, np.int32)
    links[filled] = np.arange(filled.sum(), dtype=np.int32)
    count = int(filled.sum())
    return VoxelField(links, np.full(count, 60.0, np.float32),
                      np.zeros((count, 3, basis), np.float32))


def drawn_exemplar(width: int = 96, height: int = 128) -> Exemplar:
    """A few colored shapes with a face's landmarks."""
    scale, middle = 0.3 * width, np.array([0.5 * width, 0.5 * height])
    x, y = np.meshgrid((np.arange(width) + 0.5 - middle[0]) / scale,
                       (np.arange(height) + 0.5 - middle[1]) / scale)
    head = np.hypot(x / 0.8, y / 1.1) < 1
    face = np.hypot(x / 0.6, (y - 0.1) / 0.85) < 1
    body = (np.abs(x) < 0.4 + 2 * np.clip(y - 1, 0, 9)) & (y > 0.4)
    image = np.full((height, width, 3), (90, 130, 170), np.uint8)
    for where, color in ((body, (160, 60, 50)), (head, (60, 40, 30)), (face, (225, 180, 150))):
        image[where] = color
    image += np.random.default_rng(0).integers(0, 20, image.shape, np.uint8)
    return Exemplar(image, _face() * scale + middle, "drawn", (head | body).astype(np.float32))
