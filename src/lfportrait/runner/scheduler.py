"""Run tasks: each is given out when those that it needs are done, and its outcome is taken in.

There is no schedule but the graph: of the tasks that can begin the first one goes first.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from graphlib import TopologicalSorter
from typing import Any, Protocol, TypeVar

from .failures import failure_of
from .graph import AnyTask, Task

__all__ = ["Here", "Outcome", "Runner", "outcome_of", "run_tasks"]

_PATIENCE = 0.5
"""Seconds after which it is looked again whether more tasks can run at once."""


@dataclass(frozen=True)
class Outcome:
    """How a task ended.

    Attributes
    ----------
    task
        Its name.
    error
        Cause of the failure, on one line; empty if it is done.
    figures
        Of the work.
    fault
        The traceback of an internal error; empty for errors of the user.
    worker
        Machine and process that did it.
    again
        Whether it had been done before.
    """

    task: str
    error: str = ""
    figures: dict[str, Any] = field(default_factory=dict)
    fault: str = ""
    worker: str = ""
    again: bool = False


def outcome_of(task: Task, work: Callable[[], dict[str, Any]], worker: str = "") -> Outcome:
    """How a task ends whose work is done by a call, which returns its figures."""
    try:
        return Outcome(task.name, figures=work(), worker=worker)
    except Exception as error:
        failure = failure_of(error)
        return Outcome(task.name, failure.message, fault=failure.trace, worker=worker)


Given = TypeVar("Given", bound=Task, contravariant=True)


class Runner(Protocol[Given]):
    """Interface of what runs tasks."""

    slots: int
    """Tasks that run at once."""

    def fits(self, memory: int) -> bool:
        """Whether a task that takes so many bytes can be given out now."""

    def start(self, task: Given, memory: int) -> None:
        """Give out a task whose needs are done."""

    def wait(self, seconds: float) -> list[Outcome]:
        """Outcomes of tasks that have ended, after ``seconds`` at most."""

    def close(self) -> None:
        """End: what still runs is given up."""


class Here(Runner[AnyTask]):
    """Tasks in this process, one after the other, done where they are given out.

    Parameters
    ----------
    work
        Does a task, and returns its outcome; what it raises ends the run.
    """

    slots = 1

    def __init__(self, work: Callable[[AnyTask], Outcome]) -> None:
        self._work = work
        self._ended: list[Outcome] = []

    def fits(self, memory: int) -> bool:
        """Whether nothing is left to be taken in."""
        return not self._ended

    def start(self, task: AnyTask, memory: int) -> None:
        """Do a task."""
        self._ended = [self._work(task)]

    def wait(self, seconds: float) -> list[Outcome]:
        """The outcome of the task that was done."""
        ended, self._ended = self._ended, []
        return ended

    def close(self) -> None:
        """Nothing runs any more."""


def run_tasks(tasks: Iterable[AnyTask], runner: Runner[AnyTask],
              heard: Callable[[AnyTask, Outcome | None], None] = lambda task, outcome: None,
              memory: Callable[[AnyTask], int] = lambda task: 0) -> dict[str, str]:
    """Run tasks to their end; one that fails takes only those with it that need it.

    Parameters
    ----------
    tasks
        Each after those that it needs; needs that are not among them are done.
    runner
        Runs them; it is not closed.
    heard
        Called with each task when it begins, and with its outcome when it has ended.
    memory
        Bytes that a task takes.

    Returns
    -------
    lost
        Names of the tasks that could not begin, and of the one before each that failed.
    """
    order, failed, lost = list(tasks), set[str](), dict[str, str]()
    place = {task.name: number for number, task in enumerate(order)}
    graph = TopologicalSorter({task.name: [need for need in task.needs if need in place]
                               for task in order})
    graph.prepare()
    ready, running = sorted(place[name] for name in graph.get_ready()), 0
    while ready or running:
        while ready and runner.fits(memory(order[ready[0]])):
            task = order[heapq.heappop(ready)]
            heard(task, None)
            runner.start(task, memory(task))
            running += 1
        for outcome in runner.wait(_PATIENCE):
            running -= 1
            heard(order[place[outcome.task]], outcome)
            if outcome.error:
                failed.add(outcome.task)
                continue
            graph.done(outcome.task)
            for name in graph.get_ready():
                heapq.heappush(ready, place[name])
    for task in order:
        for need in task.needs:
            if need in failed or need in lost:
                lost[task.name] = lost.get(need, need)
    return lost
