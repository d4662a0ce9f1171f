"""What work takes, learnt from what it took."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..files import read_json, write_json

__all__ = ["Costs", "Need"]

_NEWEST = 0.25
"""What the newest work counts in the mean at the least: parameters and machines change."""
_SLACK = 1.2
"""Memory of work over the largest that was measured of its kind."""


@dataclass(frozen=True)
class Need:
    """Resources of a piece of work.

    Attributes
    ----------
    seconds
        Time on one core; by the clock where that is what is learnt.
    memory
        Peak of its process in bytes.
    disk
        Bytes that it writes.
    """

    seconds: float
    memory: int = 0
    disk: int = 0

    @classmethod
    def of(cls, cost: Mapping[str, Any]) -> Need:
        """Of a task's ``cost`` (`lfportrait.measure.Cost` and bytes), on one core."""
        return cls(cost["cpu_seconds"], cost["peak_memory_bytes"], cost["bytes"])


class Costs:
    """Means of what each kind of work took.

    Parameters
    ----------
    usual
        What kinds take before any was measured.
    file
        Keeps what is learnt, if given.
    """

    def __init__(self, usual: Mapping[str, Need] | None = None, file: Path | None = None) -> None:
        self.usual, self._file = dict(usual or {}), file
        self._known: dict[str, tuple[int, Need]] = {}
        if file is not None:
            with contextlib.suppress(UserError, TypeError, ValueError, AttributeError):
                self._known = {kind: (int(count), Need(float(seconds), int(memory), int(disk)))
                               for kind, (count, seconds, memory, disk) in read_json(file).items()}

    def learn(self, kind: str, took: Need) -> None:
        """Work of a kind is done, and took this."""
        count, mean = self._known.get(kind, (0, took))
        newest = max(1.0 / (count + 1), _NEWEST)
        self._known[kind] = count + 1, Need(
            mean.seconds + newest * (took.seconds - mean.seconds), max(mean.memory, took.memory),
            round(mean.disk + newest * (took.disk - mean.disk)))
        if self._file is not None:
            with contextlib.suppress(UserError):  # a full disk loses an estimate
                write_json(self._file, {one: (times, *astuple(need))
                                        for one, (times, need) in self._known.items()})

    def need(self, kind: str) -> Need:
        """What the next work of a kind takes; of an unknown kind: the mean of all others."""
        if kind in self._known:
            need = self._known[kind][1]
            return Need(need.seconds, int(_SLACK * need.memory), need.disk)
        if kind in self.usual:
            return self.usual[kind]
        every = [need.seconds for _, need in self._known.values()]
        return Need(sum(every) / len(every) if every else 0.0)
