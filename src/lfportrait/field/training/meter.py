"""Training curves of a reconstruction, over seconds and rays."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypedDict

import numpy as np

from ...errors import UserError

__all__ = ["CurveFile", "CurvePoint", "Meter"]


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


class CurveFile:
    """A table (CSV) of the curves: a row a point, the columns as in `CurvePoint`.

    Every row is on the disk when `write` returns, so that curves can be watched as they grow.

    Parameters
    ----------
    path
        The file. A run that goes on from a checkpoint adds its rows to those that are there.

    Raises
    ------
    UserError
        If the file can't be written.
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
    """Keeps the curves of a reconstruction and writes them to a log.

    Parameters
    ----------
    log
        Where the curves go.
    every
        Seconds between two points.
    measure_every
        Seconds between two measurements on held-out views; 0 does not measure. The clock stands
        still meanwhile.
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
