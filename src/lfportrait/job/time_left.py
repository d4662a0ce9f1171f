"""The time that a job will still take, from what its steps usually cost.

Each stage shows a few steps on its progress line, and how long one takes can't be seen from the
ones before it. So there is a table of what each step usually costs (`usual_steps`). The steps that
are still to come are added up by it. That this machine is another one, or has other work, is learnt
from the steps that are done: all that is to come is scaled by what they took over what they were to
take. Kernels that are being compiled beside count as a step of their own.
"""

from __future__ import annotations

import time

import numpy as np

from ..measure import usable_cores
from .graph import MakeConfig
from .usual_steps import COMPILE, Source, Step, usual_steps
from .warmup import Warmup

__all__ = ["TimeLeft"]

_COMPILING = "compiling kernels"
_KNOWN = 5.0
"""Seconds of the table that count as measured from the first."""
_FORGET = 20.0
"""Seconds after which a step counts half for what this machine is like now."""
_ODD = 2.0
"""How many times slower than those before it a step may seem."""
_MOST = 8.0
"""How many times slower, or faster, than the table a machine may be."""


class TimeLeft:
    """The steps of a job, as its progress lines name them (`progress.Outlook`).

    Parameters
    ----------
    config
        Parameters of the job.
    source
        Its photos.
    look, only
        Whether a first look is taken, and whether the job ends with it.
    warmup
        Kernels that are being compiled beside.
    cores
        Cores that it may use; by default those of this process.
    """

    def __init__(self, config: MakeConfig, source: Source, *, look: bool = True,
                 only: bool = False, warmup: Warmup | None = None, cores: int = 0) -> None:
        self._cores = min(cores or usable_cores(), 8)
        self._warmup, self._functions = warmup, 0 if warmup is None else warmup.left
        self._steps = usual_steps(config, source, look or only, self._cores)
        if only:
            names = [step.name for step in self._steps]
            del self._steps[names.index("first look") + 1:]
        self._compile = Step("", _COMPILING, COMPILE / self._cores * self._functions)
        self._now = self._steps[0]
        self._clock = self._begun = time.perf_counter()

    def skip(self, stage: str) -> None:
        """Leave out a stage that was done before."""
        for step in self._steps:
            step.over |= step.stage == stage

    def at(self, stage: str, note: str, share: float | None = None) -> None:
        """Hear which step is being done; one that is not in the table changes nothing."""
        self._book()
        if note.startswith(_COMPILING):
            if self._warmup is not None and self._warmup.left:
                self._now = self._compile
            return
        fitting = [number for number, step in enumerate(self._steps) if step.stage == stage
                   and (note.startswith(step.name) if step.name else step is self._now)]
        if fitting:
            number = max(fitting, key=lambda one: len(self._steps[one].name))
            self._begin(number if share is None else self._count(number, share))

    def _count(self, number: int, share: float) -> int:
        """Note a step's share; the step after it where all is counted that it counts."""
        step = self._steps[number]
        low, high = step.span
        if low == high:
            return number
        step.share = min(max((share - low) / (high - low), 0.0), 1.0)
        step.first = step.share if step.first < 0.0 else step.first
        follows = number + 1 < len(self._steps) and not self._steps[number + 1].name
        return number + 1 if follows and step.share >= 0.99 else number

    def _begin(self, number: int) -> None:
        for step in self._steps[:number]:
            step.over = True
        self._now = self._steps[number]
        self._now.over = False

    def _book(self) -> None:
        """Book the time since the last call on the step that is being done."""
        now = time.perf_counter()
        self._now.spent += now - self._clock
        self._now.seen = self._clock = now

    def left(self) -> float | None:
        """Seconds that the job will still take; None in its first seconds."""
        self._book()
        if self._clock - self._begun < _KNOWN:
            return None
        pace, compiled = self._pace(), self._compiled()
        return (sum(step.left(pace) for step in self._steps)
                + pace * self._compile.usual * (1.0 - compiled))

    def _compiled(self) -> float:
        """Share of the functions to compile that is there."""
        if not self._functions or self._warmup is None:
            return 1.0
        return 1.0 - self._warmup.left / self._functions

    def _pace(self) -> float:
        """What steps have taken over what they were to take; the latest ones count most."""
        whole = self._ratio(1.0, np.inf)
        return float(np.clip(self._ratio(whole, _FORGET), 1.0 / _MOST, _MOST))

    def _ratio(self, before: float, forget: float) -> float:
        """The same where it was ``before`` at first and steps count half after some seconds."""
        took, usual = _KNOWN * before, _KNOWN
        for step in (self._compile, *self._steps):
            pace = took / usual
            done = 1.0 if step.over else max(step.share - max(step.first, 0.0), 0.0)
            if step.spent and (done or step.spent > step.usual * pace):
                weight = 0.5 ** ((self._clock - step.seen) / forget)
                expected = weight * step.usual * (done or 1.0)
                # One step that is far off says more of itself than of the machine.
                took += min(weight * step.spent, _ODD * pace * expected)
                usual += expected
        return took / usual
