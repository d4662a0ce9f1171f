"""Graphs of tasks: what needs what, and what is done."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from ..stages import finished_record

__all__ = ["AnyTask", "Plan", "Task", "finished"]


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
