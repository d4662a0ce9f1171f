"""Figures of a reconstruction: curves over seconds and rays, a forecast, and held-out photos."""

import csv
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, TypedDict

import numpy as np

from ...arrays import Bool, Float64, Int64
from ...capture import Capture
from ...errors import UserError
from ...metrics import psnr, ssim
from ...simd.threads import side_by_side
from ..config import Settings
from ..grid import VoxelField


class CurvePoint(TypedDict):
    """One point of the curves."""

    seconds: float
    """Time since the reconstruction began, pauses for measuring not counted."""
    rays: int
    """Training rays so far."""
    rays_per_second: float
    """Since the point before."""
    loss: float
    """Mean squared color error of the latest steps."""
    psnr: float
    """The same in dB."""
    voxels: int
    """Lattice points."""
    resolution: int
    """Lattice points to two world units."""
    held_out_psnr: float | None
    """PSNR in dB of the held-out views, where it was measured."""


class Curves(NamedTuple):
    """What is kept of the course of a training."""

    # File that is written as it goes (`CurveFile`): PSNR so far, loss, rays a second, points.
    log: Path | None = None
    # Seconds between measurements on held-out views; 0 measures at the end alone.
    measure_every: float = 0.0


class CurveFile:
    """A table (CSV) of the curves: a row a point, the columns as in `CurvePoint`.

    Every row is on the disk when `write` returns, so that curves can be watched as they grow. A run
    that goes on from a checkpoint adds its rows to those that are there. Raises `UserError` if the
    file can't be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = open(path, "a", encoding="utf-8", newline="")  # noqa: SIM115
        except OSError as error:
            raise UserError(f"can't write the log {path}: {error.strerror}") from error
        self._rows = csv.DictWriter(self._stream, list(CurvePoint.__annotations__))
        self._empty = self._stream.tell() == 0

    def write(self, point: CurvePoint) -> None:
        """Add a row."""
        try:
            if self._empty:
                self._rows.writeheader()
                self._empty = False
            self._rows.writerow(point)
            self._stream.flush()
        except OSError as error:
            raise UserError(f"can't write the log {self.path}: {error.strerror}; free some "
                            "space") from error

    def close(self) -> None:
        """Close the file."""
        with suppress(OSError):  # of a row that was not written and said so
            self._stream.close()


class Meter:
    """Keeps the curves of a reconstruction, a point every few seconds, and writes them to a log.

    It measures on held-out views every ``measure_every`` seconds, 0: never; the clock stands still
    meanwhile.
    """

    def __init__(self, log: CurveFile | None = None, every: float = 1.0,
                 measure_every: float = 0.0) -> None:
        self.log, self.every, self.measure_every = log, every, measure_every
        self.points: list[CurvePoint] = []
        self._start = time.perf_counter()
        self._paused = 0.0
        self._measured = 0.0
        self._first_rays = 0

    def start(self, rays: int) -> None:
        """Set the clock to zero; ``rays`` were cast by an earlier run that this one goes on from.

        Seconds count from here on.
        """
        self._start, self._paused, self._measured = time.perf_counter(), 0.0, 0.0
        self._first_rays = rays

    @property
    def seconds(self) -> float:
        """Time since the start without the pauses."""
        return time.perf_counter() - self._start - self._paused

    def skip(self, seconds: float) -> None:
        """Do not count the last seconds: something else was done."""
        self._paused += seconds

    def due(self) -> bool:
        """Whether it is time for a point; the first step makes one."""
        return not self.points or self.seconds - self.points[-1]["seconds"] >= self.every

    def record(self, rays: int, loss: float, voxels: int, resolution: int,
               measure: Callable[[], float | None] | None = None) -> None:
        """Add a point; ``measure`` gives the PSNR of held-out views, called when that is due."""
        seconds = self.seconds
        before = self.points[-1] if self.points else None
        since = seconds - (before["seconds"] if before else 0.0)
        cast = rays - (before["rays"] if before else self._first_rays)
        held_out = None
        if measure is not None and 0 < self.measure_every <= seconds - self._measured:
            began = time.perf_counter()
            held_out = measure()
            self._paused += time.perf_counter() - began
            self._measured = seconds
        point: CurvePoint = {
            "seconds": round(seconds, 3), "rays": rays,
            "rays_per_second": round(cast / max(since, 1e-9), 1), "loss": loss,
            "psnr": round(-10.0 * float(np.log10(max(loss, 1e-12))), 3), "voxels": voxels,
            "resolution": resolution, "held_out_psnr": held_out}
        self.points.append(point)
        if self.log is not None:
            self.log.write(point)

    def finish(self, rays: int, seconds: float, held_out: float) -> None:
        """Add the end: after ``seconds``, with the held-out views' PSNR in dB."""
        if self.points:
            self.points.append({**self.points[-1], "seconds": round(seconds, 3), "rays": rays,
                                "held_out_psnr": held_out})
            if self.log is not None:
                self.log.write(self.points[-1])


_GROWTH = 2.55
"""Lattice points grow with the resolution to this power: more than a surface, whose shell gets as
thin as its voxels only in the end. Measured: 2.2 to 2.8."""
_BYTES, _BYTES_LAID = 460, 590
"""Memory per lattice point, with given mattes and with recomputed ones."""


def outlook(config: Settings, seconds: float, count: int, laid: bool, used: int) -> str:
    """One line: lattice points at the last level, memory, and time from now on.

    For photos with mattes, of at least two levels: ``seconds`` and ``count`` are time and lattice
    points of the first, ``laid`` says whether mattes are recomputed, ``used`` is most memory so far
    in bytes.
    """
    first, last = config.resolutions[0], config.resolutions[-1]
    points = count * (last / first) ** _GROWTH
    memory = used + points * (_BYTES_LAID if laid else _BYTES)
    text = (f"{last} points to a head's height: up to about {points / 1e6:.1f} million in all, "
            f"{memory / 2**30:.1f} GiB")
    if config.time_budget > 0:
        return f"{text}, {config.time_budget:.0f} s as asked"
    # Beyond the processor's caches rays get slower as lattices get larger.
    speed = config.rays[0] * 1e6 / max(seconds, 1e-3)
    left = sum(rays * 1e6 / (speed * min(1.3, 0.7 * 256 / resolution))
               for rays, resolution in zip(config.rays[1:], config.resolutions[1:]))
    step = 10 ** max(0, math.floor(math.log10(max(left, 1.0))))
    return f"{text}, about {math.ceil(left / step) * step} s more"


_TOGETHER = 8_000_000  # Pixels of views that are compared at a time: each takes some 200 bytes.


def held_out_quality(field: VoxelField, capture: Capture, background: float = 1.0,
                     gains: Float64 | None = None, some: Int64 | None = None,
                     others: Mapping[str, tuple[Capture, Float64 | None]] | None = None,
                     kept: Sequence[Bool] | None = None) -> dict[str, float]:
    """Mean PSNR (dB) and SSIM of the held-out views, composited on ``background``.

    Renders are multiplied by ``gains`` [V, 3], the photos' exposures, before they are compared.
    ``some`` are numbers of held-out views, from 0; by default all count. ``others`` are the same
    views with other mattes or exposures: their PSNR comes by their names. ``kept`` are pixels
    [H, W] of each view over which the PSNR is taken once more: ``psnr_kept``.
    """
    tests = capture.testing()
    # Layouts are built on first use: not by several threads.
    _ = field.bricks.rows

    variants: dict[str, tuple[Capture, Float64 | None, Sequence[Bool] | None]] = {
        "psnr": (capture, gains, None),
        **{name: (*other, None) for name, other in (others or {}).items()}}
    if kept is not None:
        variants["psnr_kept"] = capture, gains, kept

    def scores(index: int) -> list[float]:
        """PSNR of one view in all variants, and SSIM in the first."""
        view = int(tests[index])
        shot = field.render(capture.cameras, view, background=background)
        found: list[float] = []
        for photos, factors, counted in variants.values():
            image = shot.color
            if factors is not None:
                gain = factors[index].astype(np.float32)
                # Behind a person with a matte stands the same grey whatever the exposure.
                behind = (background * (1.0 - shot.alpha[..., None])
                          if photos.alphas is not None else 0)
                image = (image - behind) * gain + behind
            pair = np.clip(image, 0, 1), photos.image_float(view, background)
            mask = None if counted is None else counted[index]
            found += [psnr(*pair, mask)] if found else [ssim(*pair), psnr(*pair)]
        return found

    numbers = range(len(tests)) if some is None else [int(one) for one in some]
    largest = int((capture.cameras.width * capture.cameras.height).max())
    found = side_by_side(scores, numbers, max(1, _TOGETHER // largest))
    means = np.mean(found, axis=0)
    return {"ssim": float(means[0]), "views": len(found),
            **dict(zip(variants, map(float, means[1:])))}
