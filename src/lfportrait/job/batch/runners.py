"""Runners of tasks: the interface, and the local one.

Processes stay: each imports the package and reads the kernels once and then does task after task.
One that dies (killed, out of memory) breaks nothing but its own task: it is replaced, and the task
given out again. When the batch itself is killed they end, too, wherever they are.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from ...measure import THREADS, free_memory_bytes, usable_cores
from ..graph import Task
from .work import Outcome

__all__ = ["ATTEMPTS", "KERNELS", "LocalRunner", "Runner", "thread_settings"]

ATTEMPTS = 3
"""How often a task is given out whose worker dies."""
KERNELS = ("reconstruct", "transfer", "stylize", "encode")
"""What tasks need compiled."""
_MEMORY_SHARE = 0.85
"""Part of the free memory that tasks may take together."""


class Runner(Protocol):
    """Interface of what runs tasks."""

    slots: int
    """Tasks that run at once."""

    def fits(self, memory: int) -> bool:
        """Whether a task that takes so many bytes can be given out now."""

    def start(self, task: Task, memory: int) -> None:
        """Give out a task whose needs are done."""

    def wait(self, seconds: float) -> list[Outcome]:
        """Outcomes of tasks that have ended, after ``seconds`` at most."""

    def close(self) -> None:
        """End: what still runs is given up."""


def thread_settings(cores: int) -> dict[str, str]:
    """Environment of a process whose tasks use ``cores`` cores."""
    return dict.fromkeys(THREADS, str(cores))


class _Died(Exception):
    """A worker ended before its task did."""


class _Worker:
    """A process that does one task at a time and communicates through its pipes."""

    def __init__(self, settings: dict[str, str], log: Path) -> None:
        self._settings, self._log = settings, log
        self._process: subprocess.Popen[bytes] | None = None
        # Waits for the process's answer.
        self._thread = ThreadPoolExecutor(1)
        self.task: Task | None = None
        self.memory = 0
        self.attempts = 0

    def submit(self, task: Task, results: Path) -> Future[Outcome]:
        """Have a task done; a process that is not there, or died, is started first."""
        self.task = task
        self.attempts += 1
        if self._process is None or self._process.poll() is not None:
            self.end()
            with open(self._log, "ab") as log:
                self._process = subprocess.Popen(
                    [sys.executable, "-c", "from lfportrait.job.batch.serving import serve; "
                     "serve()"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log,
                    env={**os.environ, **self._settings})
        return self._thread.submit(self._exchange, self._process, task, results)

    def _exchange(self, process: subprocess.Popen[bytes], task: Task, results: Path) -> Outcome:
        assert process.stdin is not None and process.stdout is not None
        try:
            pickle.dump((task, results), process.stdin)
            process.stdin.flush()
            outcome = pickle.load(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            process.kill()
            process.wait()
            raise _Died from error
        assert isinstance(outcome, Outcome)
        return outcome

    def end(self) -> None:
        """Kill the process, whatever it does."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                assert pipe is not None
                with suppress(OSError):
                    pipe.close()
            self._process = None

    def close(self) -> None:
        """End for good."""
        if self._process is not None:
            self._process.kill()
        self._thread.shutdown()
        self.end()


class LocalRunner:
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
        self._idle = [_Worker(thread_settings(cores), log) for _ in range(self.slots)]
        self._busy: dict[Future[Outcome], _Worker] = {}
        free = free_memory_bytes()
        self._memory = None if free is None else _MEMORY_SHARE * free

    def fits(self, memory: int) -> bool:
        """Whether there is a process, and memory beside what the others take."""
        taken = sum(worker.memory for worker in self._busy.values())
        # A task that is larger than all there is may try it alone.
        return bool(self._idle) and (not self._busy or self._memory is None
                                     or taken + memory <= self._memory)

    def start(self, task: Task, memory: int) -> None:
        """Give out a task."""
        worker = self._idle.pop()
        worker.memory, worker.attempts = memory, 0
        self._busy[worker.submit(task, self._results)] = worker

    def wait(self, seconds: float) -> list[Outcome]:
        """Outcomes of tasks that have ended, after ``seconds`` at most."""
        done, _ = wait(self._busy, seconds, FIRST_COMPLETED)
        outcomes = []
        for future in done:
            worker = self._busy.pop(future)
            task = worker.task
            assert task is not None
            try:
                outcome = future.result()
            except _Died:
                if worker.attempts < ATTEMPTS:
                    self._busy[worker.submit(task, self._results)] = worker
                    continue
                outcome = Outcome(task.name, f"its process died {ATTEMPTS} times, as it does where "
                                  "memory is short: let fewer tasks run at once (--workers)")
            self._idle.append(worker)
            outcomes.append(outcome)
        return outcomes

    def close(self) -> None:
        """End all processes; what still runs is given up."""
        for worker in [*self._idle, *self._busy.values()]:
            worker.close()
