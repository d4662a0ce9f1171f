"""Progress of long work: one line on standard error that is redrawn in place."""

from __future__ import annotations

import re
import sys
import threading
import time
from collections.abc import Callable
from typing import Protocol, TextIO

_SURE, _SECONDS = 0.02, 2.0
"""Part of the work, and seconds, that must be known of its speed before a time left is shown."""


_NUMBER = re.compile(r"[,:]? \d")
"""Ends the name of a step in a note: ``"refine 3 of 40: 0.8"``, ``"128^3, 1.2 M voxels"``."""
_COUNT = re.compile(r"(\d+) of (\d+)")  # How far a step is, in a note.


class Outlook(Protocol):
    """Knows the time that is left of a whole job, of which a line shows one stage."""

    def at(self, stage: str, note: str, share: float | None = None) -> None:
        """Hear a stage's note, and which share is done of what it counts."""

    def left(self) -> float | None:
        """Seconds until the job's end; None while too little is known."""


class Progress:
    """A progress line for one stage, silent where it is not wanted.

    Parameters
    ----------
    title : What is being done, e.g. ``"reconstruct"``.
    total : Number of steps; 0 if unknown.
    enabled : False prints nothing at all. A terminal sees a line redrawn at most ten times a
        second, and at once where another step begins; a file sees a line every ten seconds.
    outlook : Shows the time that is left of the whole job instead of the stage's; the line is
        then drawn every second, whether there is news or not.

    Examples
    --------
    >>> with Progress("views", total=3, enabled=False) as progress:
    ...     for _ in range(3):
    ...         progress.step("a note")
    """

    def __init__(self, title: str, total: int = 0, enabled: bool = True,
                 stream: TextIO | None = None, outlook: Outlook | None = None) -> None:
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
        self._note, self._outlook = "", outlook
        self._lock, self._closed = threading.RLock(), threading.Event()
        if outlook is not None:
            outlook.at(title, "start")

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
        with self._lock:
            self.done, self._note = done, note
            self._count(note)
            if self._outlook is not None:
                self._outlook.at(self.title, note, self._share(note))
            if done > 0 and self._begun is None:
                # Compiling and reading come first and say nothing of the speed of the rest.
                self._begun = time.perf_counter(), done
            if self.enabled and self._due(note, 0.1 if self._tty else 10.0, changes=self._tty):
                self._write(note)

    def _share(self, note: str) -> float | None:
        """What is done, by the steps or by a note's own count; None where nothing is counted."""
        if self.total:
            return min(1.0, self.done / self.total)
        count = _COUNT.search(note)
        return int(count[1]) / max(1, int(count[2])) if count else None

    def _tick(self) -> None:
        """Draw the line again every second, until it is closed: the time goes on."""
        while not self._closed.wait(1.0):
            with self._lock:
                if self.enabled and self._due(self._note, 0.9 if self._tty else 10.0):
                    self._write(self._note)

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

    def show(self, make: Callable[[], object], *, at_once: bool = False) -> None:
        """Offer an intermediate result, made by a call where it is wanted: a line wants none.

        ``at_once``: however short a time ago the last one was.
        """

    def say(self, line: str) -> None:
        """Write a line that stays, above the one that is redrawn."""
        with self._lock:
            if self.enabled:
                text = f"{self.title}: {line}"
                self._stream.write(("\r" if self._tty else "") + text.ljust(self._width) + "\n")
                self._stream.flush()

    def _write(self, note: str, end: bool = False) -> None:
        elapsed = time.perf_counter() - self._start
        share = min(1.0, self.done / self.total) if self.total and not end else None
        left = "" if end else self._told_left(share)
        if share is None and not left:
            text = f"{self.title}: {elapsed:.1f} s  {note}"
        else:
            part = "" if share is None else f"{100 * share:3.0f} %  "
            text = f"{self.title}: {part}{elapsed:.0f} s{left}  {note}"
        text = text.rstrip()
        if self._tty:
            self._stream.write("\r" + text.ljust(self._width) + ("\n" if end else ""))
            self._width = len(text)
        else:
            self._stream.write(text + "\n")
        self._stream.flush()

    def _told_left(self, share: float | None) -> str:
        """The time that is left, of the job or else of the stage, in words; empty: unknown."""
        if self._outlook is not None:
            left = self._outlook.left()
            return "" if left is None else f", {left:.0f} s left in all"
        left = None if share is None else self._left(share)
        return "" if left is None else f", {left:.0f} s left"

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
        self._closed.set()
        with self._lock:
            if self.enabled:
                self._write(note, end=True)
                self.enabled = False

    def __enter__(self) -> Progress:
        if self._outlook is not None and self.enabled:
            threading.Thread(target=self._tick, daemon=True).start()
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self.close("" if kind is None else "stopped")


def note(progress: Progress | None, text: str) -> None:
    """Show ``text`` behind the bar, where there is a line."""
    if progress is not None:
        progress.update(progress.done, text)


def say(progress: Progress | None, line: str) -> None:
    """Write a line that stays, where there is a progress line."""
    if progress is not None:
        progress.say(line)
