"""The runner of tasks on this machine.

Processes stay: each imports the package and reads the kernels once and then does task after task.
One that dies (killed, out of memory) breaks nothing but its own task: it is replaced, and the task
given out again. When the batch itself is killed they end, too, wherever they are.
"""

from __future__ import annotations

import queue
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...measure import THREADS, free_memory_bytes, usable_cores
from ...runner import Child, Outcome, Pipe, Runner
from ..graph import Task
from .work import do_task

__all__ = ["ATTEMPTS", "KERNELS", "LocalRunner", "serve", "thread_settings"]

ATTEMPTS = 3
"""How often a task is given out whose worker dies."""
KERNELS = ("reconstruct", "transfer", "stylize", "encode")
"""What tasks need compiled."""
_MEMORY_SHARE = 0.85
"""Part of the free memory that tasks may take together."""


def thread_settings(cores: int) -> dict[str, str]:
    """Environment of a process whose tasks use ``cores`` cores."""
    return dict.fromkeys(THREADS, str(cores))


@dataclass(eq=False)
class _Worker:
    """A process that does one task at a time, once it has started."""

    child: Child | None = None
    task: Task | None = None
    memory: int = 0
    attempts: int = 0


def serve() -> None:
    """Do tasks in a process of its own until the batch ends."""
    pipe = Pipe()
    while True:
        pipe.tell(do_task(*pipe.requests.get()))


class LocalRunner(Runner[Task]):
    """Processes on this machine.

    Parameters
    ----------
    results
        Folder of all results.
    cores
        Of each task.
    workers
        Processes; 0: as many as there are cores for.
    log
        File for what workers print.
    """

    def __init__(self, results: Path, cores: int, workers: int, log: Path) -> None:
        self.slots = workers or max(1, usable_cores() // cores)
        self._results = results
        self._settings, self._log = thread_settings(cores), log
        self._idle = [_Worker() for _ in range(self.slots)]
        self._busy: list[_Worker] = []
        self._heard: queue.SimpleQueue[tuple[_Worker, Child, Any]] = queue.SimpleQueue()
        free = free_memory_bytes()
        self._memory = None if free is None else _MEMORY_SHARE * free

    def fits(self, memory: int) -> bool:
        """Whether there is a process, and memory beside what the others take."""
        taken = sum(worker.memory for worker in self._busy)
        # A task that is larger than all there is may try it alone.
        return bool(self._idle) and (not self._busy or self._memory is None
                                     or taken + memory <= self._memory)

    def start(self, task: Task, memory: int) -> None:
        """Give out a task."""
        worker = self._idle.pop()
        worker.task, worker.memory, worker.attempts = task, memory, 0
        self._busy.append(worker)
        self._give(worker)

    def _give(self, worker: _Worker) -> None:
        """Have a worker do its task; a process that is not there, or died, is started first."""
        worker.attempts += 1
        if worker.child is None or not worker.child.alive:
            if worker.child is not None:
                worker.child.close()
            child = worker.child = Child("lfportrait.job.batch.runners:serve", self._log,
                                         self._settings)
            child.listen(lambda message: self._heard.put((worker, child, message)))
        with suppress(OSError):  # it has ended, which is heard
            worker.child.send((worker.task, self._results))

    def wait(self, seconds: float) -> list[Outcome]:
        """Outcomes of tasks that have ended, after ``seconds`` at most."""
        outcomes = []
        with suppress(queue.Empty):
            heard = self._heard.get(timeout=seconds)
            while True:
                outcome = self._outcome(*heard)
                if outcome is not None:
                    outcomes.append(outcome)
                heard = self._heard.get_nowait()
        return outcomes

    def _outcome(self, worker: _Worker, child: Child, message: Any) -> Outcome | None:
        """How a worker's task has ended; None where it is given out again."""
        if message is None:
            child.close()
        if worker not in self._busy or child is not worker.child:
            return None  # the end of a process that had nothing to do
        assert worker.task is not None
        if message is not None:
            (outcome,) = message
        elif worker.attempts < ATTEMPTS:
            self._give(worker)
            return None
        else:
            outcome = Outcome(worker.task.name, f"its process died {ATTEMPTS} times, as it does "
                              "where memory is short: let fewer tasks run at once (--workers)")
        self._busy.remove(worker)
        self._idle.append(worker)
        assert isinstance(outcome, Outcome)
        return outcome

    def close(self) -> None:
        """End all processes; what still runs is given up."""
        for worker in [*self._idle, *self._busy]:
            if worker.child is not None:
                worker.child.close()
