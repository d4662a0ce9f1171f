"""Estimate a task's cores, memory, time and disk space.

The figures of `STAGES` were measured (`docs/scale.md`); the tasks of a batch that are done correct
them: what a stage took there, its next tasks are taken to need.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..graph import STAGES, Need, Plan

__all__ = ["Estimates", "cores_of_a_task"]


_SLACK = 1.2
"""Memory of a task over the largest that was measured of its stage in this batch."""


@dataclass
class _Measured:
    """Tasks of a stage that are done: how many, their times and files together, the most memory."""

    count: int = 0
    core_seconds: float = 0.0
    memory: int = 0
    disk: int = 0


class Estimates:
    """Estimated costs of a batch's stages, from declared and measured values."""

    def __init__(self, figures: Iterable[tuple[str, dict[str, Any]]] = ()) -> None:
        self._found: dict[str, _Measured] = {}
        for stage, found in figures:
            self.learn(stage, found)

    def learn(self, stage: str, figures: dict[str, Any]) -> None:
        """Take the figures of a task that is done into account."""
        if "cost" in figures:
            found = self._found.setdefault(stage, _Measured())
            found.count += 1
            found.core_seconds += figures["cost"]["cpu_seconds"]
            found.disk += figures["cost"]["bytes"]
            found.memory = max(found.memory, figures["cost"]["peak_memory_bytes"])

    def need(self, stage: str) -> Need:
        """Estimated needs of a stage's next task."""
        found = self._found.get(stage)
        if found is None:
            return STAGES[stage].need
        return Need(found.core_seconds / found.count, int(_SLACK * found.memory),
                    round(found.disk / found.count))


def cores_of_a_task(plan: Plan, cores: int) -> int:
    """Cores for each task where none are asked for.

    Tasks beside each other on a core each waste least, so they get more only where there are fewer
    sitters than cores. It follows from the whole plan, not from what is left of it: what is
    computed depends on the number of threads in its last bits, and a batch that goes on must end
    with the same files.
    """
    sitters = len({task.sitter for task in plan.tasks.values()})
    return max(1, min(8, cores // max(1, sitters)))
