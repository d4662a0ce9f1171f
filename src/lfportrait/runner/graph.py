"""Graphs of tasks: what needs what, what is done, what can begin."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from ..stages import finished_record

__all__ = ["Left", "Plan", "Task", "finished"]


@dataclass(frozen=True)
class Task:
    """A piece of work: files in, files out.

    Attributes
    ----------
    name
        Its place in the plan; what follows the last ``/`` is the name of its record.
    stage
        The kind of work.
    folder
        Where it writes, relative to the results.
    outputs
        What it writes there.
    key
        Hash of all that the outputs depend on.
    needs
        Names of the tasks whose outputs it reads.
    """

    name: str
    stage: str
    folder: str
    outputs: tuple[str, ...]
    key: str
    needs: tuple[str, ...]

    @property
    def record(self) -> str:
        """Name of its record in the folder."""
        return self.name.rpartition("/")[2]


AnyTask = TypeVar("AnyTask", bound=Task)


def finished(task: Task, results: Path) -> dict[str, Any] | None:
    """The figures of a task whose outputs are there, made from the same inputs; else None."""
    return finished_record(results / task.folder, task.record, task.key, task.outputs)


@dataclass
class Plan(Generic[AnyTask]):
    """Tasks, each after those that it needs.

    Attributes
    ----------
    tasks
        By name.
    refused
        What can't be begun at all, and why.
    """

    tasks: dict[str, AnyTask] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)

    def wanted(self) -> list[AnyTask]:
        """The tasks that nothing else needs: what the user gets."""
        needed = {need for task in self.tasks.values() for need in task.needs}
        return [task for task in self.tasks.values() if task.name not in needed]

    def done(self, results: Path) -> set[str]:
        """Names of the tasks that were done before, from the same inputs."""
        return {name for name, task in self.tasks.items() if finished(task, results) is not None}

    def to_do(self, done: set[str]) -> list[AnyTask]:
        """The tasks that are left, where these are done: what leads to something missing."""
        lacking: set[str] = set()
        left = [task.name for task in self.wanted() if task.name not in done]
        while left:
            name = left.pop()
            if name not in lacking:
                lacking.add(name)
                left += [need for need in self.tasks[name].needs if need not in done]
        return [task for name, task in self.tasks.items() if name in lacking]


class Left(Generic[AnyTask]):
    """The tasks that are left, those first whose needs are done, in their order."""

    def __init__(self, tasks: Iterable[AnyTask]) -> None:
        self._order: Sequence[AnyTask] = list(tasks)
        self._tasks = {task.name: task for task in self._order}
        self._place = {task.name: place for place, task in enumerate(self._order)}
        self._lacks = {task.name: {need for need in task.needs if need in self._tasks}
                       for task in self._order}
        self._followers: dict[str, list[str]] = {}
        for name, lacks in self._lacks.items():
            for need in lacks:
                self._followers.setdefault(need, []).append(name)
        # In order, so a heap already.
        self._ready = [self._place[name] for name, lacks in self._lacks.items() if not lacks]

    def __len__(self) -> int:
        """Tasks that have not ended."""
        return len(self._tasks)

    def first(self) -> AnyTask | None:
        """The first task that can begin."""
        while self._ready and self._order[self._ready[0]].name not in self._tasks:
            heapq.heappop(self._ready)
        return self._order[self._ready[0]] if self._ready else None

    def take(self) -> None:
        """The first task begins."""
        heapq.heappop(self._ready)

    def done(self, name: str) -> None:
        """A task is done: others may be ready."""
        del self._tasks[name]
        for other in self._followers.get(name, ()):
            self._lacks[other].discard(name)
            if not self._lacks[other] and other in self._tasks:
                heapq.heappush(self._ready, self._place[other])

    def failed(self, name: str) -> list[str]:
        """A task failed: those that wait for it, which can't be done now."""
        del self._tasks[name]
        lost, left = [], list(self._followers.get(name, ()))
        while left:
            other = left.pop()
            if self._tasks.pop(other, None) is not None:
                lost.append(other)
                left += self._followers.get(other, ())
        return lost
