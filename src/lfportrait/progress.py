"""Progress of long work: one line on standard error that is redrawn in place."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable
from typing import TextIO

__all__ = ["Progress"]

_SURE, _SECONDS = 0.02, 2.0
"""Part of the work, and seconds, that must be known of its speed before a time left is shown."""


_NUMBER = re.compile(r"[,:]? \d")
"""Ends the name of a step in a note: ``"refine 3 of 40: 0.8"``, ``"128^3, 1.2 M voxels"``."""


class Progress:
    """A progress line for one stage, silent where it is not wanted.

    Parameters
    ----------
    title
        What is being done, e.g. ``"reconstruct"``.
    total
        Number of steps; 0 if unknown.
    enabled
        False prints nothing at all. A terminal sees a line redrawn at most ten times a second, and
        at once where another step begins; a file sees a line every ten seconds.

    Examples
    --------
    >>> with Progress("views", total=3, enabled=False) as progress:
    ...     for _ in range(3):
    ...         progress.step("a note")
    """

    def __init__(self, title: str, total: int = 0, enabled: bool = True,
                 stream: TextIO | None = None) -> None:
        self.title = title
        self.total = total
        self.done = 0
        self.enabled = enabled
        self._stream = stream if stream is not None else sys.stderr
        self._tty = self._stream.isatty()
        self._start = time.perf_counter()
        self._last = -1e9 if self._tty else self._start
        self._step = ""
        self._width = 0
        self._begun: tuple[float, float] | None = None
        self._costs: dict[str, list[float]] = {}
        self._now = "", self._start, time.process_time()

    @property
    def costs(self) -> dict[str, tuple[float, float]]:
        """Seconds, and seconds on the cores, of each step so far, in the order they began.

        A step is what a note says before its counts: its work comes after the note. What
        comes before the first note is the step ``"start"``.
        """
        self._count("")
        return {name: (round(wall, 3), round(cores, 3))
                for name, (wall, cores) in self._costs.items() if wall >= 0.01}

    def _count(self, note: str) -> None:
        """Book the time since the last note on its step; ``note`` begins the next one."""
        name, wall, cores = self._now
        now = time.perf_counter(), time.process_time()
        spent = self._costs.setdefault(name or "start", [0.0, 0.0])
        spent[0] += now[0] - wall
        spent[1] += now[1] - cores
        self._now = _NUMBER.split(note)[0] or name, *now

    def step(self, note: str = "", count: int = 1) -> None:
        """Count ``count`` finished steps and show ``note`` behind the bar."""
        self.update(self.done + count, note)

    def update(self, done: int, note: str = "") -> None:
        """Set the number of finished steps and show ``note`` behind the bar."""
        self.done = done
        self._count(note)
        if done > 0 and self._begun is None:
            # Compiling and reading come first and say nothing of the speed of the rest.
            self._begun = time.perf_counter(), done
        if self.enabled and self._due(note, 0.1 if self._tty else 10.0, changes=self._tty):
            self._write(note)

    def _due(self, note: str, seconds: float, changes: bool = True) -> bool:
        """Whether to write: every few seconds, and at once where another step begins.

        Notes that differ in numbers alone are of the same step. The first note of a step would
        else be dropped where it comes right after the last one of the step before.
        """
        now = time.perf_counter()
        step = re.sub(r"\d+", "", note)
        if now - self._last < seconds and not (changes and step != self._step):
            return False
        self._last, self._step = now, step
        return True

    def show(self, make: Callable[[], object]) -> None:
        """Offer an intermediate result, made by a call where it is wanted: a line wants none."""

    def say(self, line: str) -> None:
        """Write a line that stays, above the one that is redrawn."""
        if self.enabled:
            text = f"{self.title}: {line}"
            self._stream.write(("\r" if self._tty else "") + text.ljust(self._width) + "\n")
            self._stream.flush()

    def _write(self, note: str, end: bool = False) -> None:
        elapsed = time.perf_counter() - self._start
        if self.total and not end:
            share = min(1.0, self.done / self.total)
            left = self._left(share)
            text = (f"{self.title}: {100 * share:3.0f} %  {elapsed:.0f} s"
                    f"{'' if left is None else f', {left:.0f} s left'}  {note}")
        else:
            text = f"{self.title}: {elapsed:.1f} s  {note}"
        text = text.rstrip()
        if self._tty:
            self._stream.write("\r" + text.ljust(self._width) + ("\n" if end else ""))
            self._width = len(text)
        else:
            self._stream.write(text + "\n")
        self._stream.flush()

    def _left(self, share: float) -> float | None:
        """Seconds that are left at the speed so far; None where too little is known of it."""
        if self._begun is None:
            return None
        since, first = self._begun
        passed, gained = time.perf_counter() - since, share - min(1.0, first / self.total)
        if passed < _SECONDS or gained < _SURE:
            return None
        return (1.0 - share) * passed / gained

    def close(self, note: str = "") -> None:
        """Write the last line: the time taken and ``note``."""
        if self.enabled:
            self._write(note, end=True)
            self.enabled = False

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self.close("" if kind is None else "stopped")
