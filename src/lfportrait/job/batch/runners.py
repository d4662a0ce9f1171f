"""Where tasks run: what a batch asks of a runner, and the one on this machine.

Processes stay: each imports the package and reads the kernels once and then does task after task.
One that dies (killed, out of memory) breaks nothing but its own task: it is replaced, and the task
given out again. When the batch itself is killed they end, too, wherever they are.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol

from ...measure import free_memory_bytes
from .plan import Task
from .work import Outcome, do_task

__all__ = ["ATTEMPTS", "KERNELS", "LocalRunner", "Runner", "thread_settings", "usable_cores"]

ATTEMPTS = 3
"""How often a task is given out whose worker dies."""
KERNELS = ("reconstruct", "transfer", "stylize", "encode")
"""What tasks need compiled."""
_MEMORY_SHARE = 0.85
"""Part of the free memory that tasks may take together."""


class Runner(Protocol):
    """What runs tasks."""

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


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def thread_settings(cores: int) -> dict[str, str]:
    """Environment of a process whose tasks have so many cores."""
    names = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return dict.fromkeys(names, str(cores))


@contextmanager
def _environment(settings: dict[str, str]) -> Iterator[None]:
    """Variables that processes which are started in the block inherit."""
    before = {name: os.environ.get(name) for name in settings}
    os.environ.update(settings)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _settle(log: str) -> None:
    """In a new worker: its words go to a file, and it ends with the batch."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
    with suppress(OSError):
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
        os.dup2(descriptor, 1)
        os.dup2(descriptor, 2)


class _Worker:
    """A process that does one task at a time."""

    def __init__(self, settings: dict[str, str], log: Path) -> None:
        self._settings, self._log = settings, log
        self.task: Task | None = None
        self.memory = 0
        self.attempts = 0
        self._pool = self._new_pool()

    def _new_pool(self) -> ProcessPoolExecutor:
        # Not forked: a fork inherits locks that other threads hold at that moment.
        return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _settle,
                                   (str(self._log),))

    def submit(self, task: Task, results: Path) -> Future[Outcome]:
        self.task = task
        self.attempts += 1
        with _environment(self._settings):
            try:
                return self._pool.submit(do_task, task, results)
            except BrokenProcessPool:  # it died between two tasks
                self.replace()
                return self._pool.submit(do_task, task, results)

    def replace(self) -> None:
        """A new process in the place of one that died."""
        self.end()
        self._pool = self._new_pool()

    def end(self) -> None:
        """Kill the process, whatever it does."""
        processes = list((self._pool._processes or {}).values())
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()


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
            except BrokenProcessPool:
                worker.replace()
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
            worker.end()
