"""Where the tasks of a batch run: on this machine, or on a Ray cluster.

A task that is done from the same inputs is not done again, so one that is given out twice, because
word of it was lost, is no harm.

On this machine processes stay: each imports the package and reads the kernels once and then does
task after task. One that dies (killed, out of memory) breaks nothing but its own task: it is
replaced, and the task given out again. When the batch itself is killed they end, too, wherever they
are.

Ray places tasks by the cores and the memory that they declare, and gives them out again where a
process or a machine dies. Files are not its business: all machines see the results and the photos
under the same paths (NFS or another shared folder). A machine needs the package and nothing else.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import socket
import time
import warnings
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...cache import StageFolder
from ...errors import UserError
from ...files import lock
from ...measure import THREADS, cost_of, free_memory_bytes, usable_cores
from ...runner import Child, Failure, Outcome, Runner, Workers, finished, outcome_of, serve
from ..graph import Task
from ..warmup import Warmup
from ..work import Tools, do_stage

ATTEMPTS = 3  # How often a task is given out whose worker dies.
KERNELS = ("reconstruct", "transfer", "stylize", "encode")  # What tasks need compiled.
_MEMORY_SHARE = 0.85  # Part of the free memory that tasks may take together.


def thread_settings(cores: int) -> dict[str, str]:
    """Environment of a process whose tasks use ``cores`` cores."""
    return dict.fromkeys(THREADS, str(cores))


def _work(request: tuple[Task, Path], _: Callable[..., None]) -> Outcome:
    return do_task(*request)


def serve_batch() -> None:
    """Do tasks in a process of its own until the batch ends."""
    serve(_work)


class LocalRunner(Workers[Task]):
    """Processes on this machine, by default as many as fit; each task has ``cores``."""

    def __init__(self, results: Path, cores: int, workers: int, log: Path) -> None:
        free, settings = free_memory_bytes(), thread_settings(cores)
        super().__init__(
            workers or max(1, usable_cores() // cores),
            lambda _: Child("lfportrait.job.batch.runners:serve_batch", log, settings),
            lambda task: (task, results),
            Failure("killed", f"its process died {ATTEMPTS} times, as it does where memory is "
                    "short: let fewer tasks run at once (--workers)"), attempts=ATTEMPTS,
            memory=None if free is None else _MEMORY_SHARE * free)


def do_task(task: Task, results: Path) -> Outcome:
    """Do a task; failures of any kind are stored in its outcome, none is raised."""
    worker = f"{socket.gethostname()}:{os.getpid()}"
    before = finished(task, results)
    if before is not None:
        return Outcome(task.name, figures=before, worker=worker, again=True)
    return outcome_of(task, lambda: _done(task, results), worker)


def _done(task: Task, results: Path) -> dict[str, Any]:
    """Do the stage's work; its figures, notes, cost and bytes written."""
    folder = StageFolder(results / task.folder)

    def work() -> dict[str, Any]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("ignore")
            warnings.filterwarnings("always", category=UserWarning, module=r"lfportrait\w*\.")
            tools = Tools(device=task.device)
            cost, figures = cost_of(lambda: do_stage(task, results, folder, tools))
        written = sum(_size(folder.folder / name)
                      for name in (*task.outputs, *figures.get("more", ())))
        notes = list(dict.fromkeys(" ".join(str(one.message).split()) for one in caught))
        return {**figures, "notes": notes, "cost": {**asdict(cost), "bytes": written}}

    return folder.run(task.record, task.key, task.outputs, work)


def _size(path: Path) -> int:
    if path.is_dir():
        return sum(one.stat().st_size for one in path.rglob("*") if one.is_file())
    return path.stat().st_size


_QUEUED = 2  # Tasks that Ray has for each core: one that runs and one that can follow at once.
_PATIENCE = 10.0  # Seconds until files that another machine wrote must be seen here.


@functools.cache
def _compile_once() -> None:
    """The kernels of this machine, compiled by the first process that needs them."""
    from ...simd.host import cache_folder

    cache_folder().mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        stack.callback(lock(cache_folder() / "warm.lock", wait=-1).release)
        stack.enter_context(Warmup(KERNELS)).wait(KERNELS)


def _do_remotely(task: Task, results: Path) -> Outcome:
    _compile_once()
    return do_task(task, results)


def _join(ray: Any, address: str | None) -> None:
    """Join a cluster, or begin one on this machine, of the cores that a container allows."""
    quiet = {"log_to_driver": False, "logging_level": logging.ERROR}
    if address is None:
        try:
            ray.init(None, num_cpus=usable_cores(), **quiet)
            return
        except ValueError:  # it runs already and has its own number of cores
            pass
    ray.init(address, **quiet)


def _joined(address: str) -> Any:
    """Ray, as a part of the cluster."""
    if address != "ray" and not address.startswith("ray://"):
        raise UserError(f"--on takes local, ray or ray://HOST:PORT, not {address!r}")
    try:
        import ray
    except ImportError as error:
        raise UserError("--on ray needs Ray: pip install 'lfportrait[ray]'") from error
    if not ray.is_initialized():
        try:
            _join(ray, None if address == "ray" else address)
        except Exception as error:  # as many kinds as there are ways to a cluster
            reason = " ".join(str(error).split())[:200]
            raise UserError(f"can't join the Ray cluster {address}: {reason}") from error
    return ray


class RayRunner(Runner[Task]):
    """A Ray cluster, whose machines share the folder of all results.

    ``address`` is ``ray``: the cluster that runs here or that ``RAY_ADDRESS`` names, else one of
    this machine; or ``ray://HOST:PORT``: one elsewhere. Each task has ``cores``, 0: one;
    ``workers`` run at once, 0: as many as there are cores for.
    """

    def __init__(self, address: str, results: Path, cores: int, workers: int) -> None:
        self._ray = _joined(address)
        self._results, self._cores, self._workers = results.absolute(), cores or 1, workers
        self._running: dict[Any, Task] = {}
        self._function = self._ray.remote(_do_remotely)
        # An environment of the task's own: a cluster that is joined already has its own.
        self._options: dict[str, Any] = {
            "num_cpus": self._cores, "max_retries": ATTEMPTS - 1,
            "runtime_env": {"env_vars": thread_settings(self._cores)}}
        self.slots = workers or self._slots()

    def _slots(self) -> int:
        """Tasks for which the cluster has cores now."""
        return max(1, int(self._ray.cluster_resources().get("CPU", 1)) // self._cores)

    def fits(self, memory: int) -> bool:
        """Whether Ray has few enough tasks; it looks after memory itself."""
        if len(self._running) >= _QUEUED * self.slots:
            # Machines come and go.
            self.slots = self._workers or self._slots()
        return len(self._running) < (self._workers or _QUEUED * self.slots)

    def start(self, task: Task, memory: int) -> None:
        """Give out a task."""
        most = max((node["Resources"].get("memory", 0) for node in self._ray.nodes()
                    if node["Alive"]), default=0)
        function = self._function.options(memory=int(min(memory, most)), **self._options)
        self._running[function.remote(task, self._results)] = task

    def wait(self, seconds: float) -> list[Outcome]:
        """Outcomes of tasks that have ended, after ``seconds`` at most."""
        if not self._running:
            return []
        ready, left = self._ray.wait(list(self._running), timeout=seconds)
        if left:
            ready += self._ray.wait(left, num_returns=len(left), timeout=0)[0]
        return [self._outcome(reference) for reference in ready]

    def _outcome(self, reference: Any) -> Outcome:
        task = self._running.pop(reference)
        try:
            outcome: Outcome = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            reason = " ".join(str(error).split())[:200]
            return Outcome(task.name, f"its process died {ATTEMPTS} times, or Ray could not run "
                           f"it: {reason}")
        if not outcome.error and not self._seen(task):
            return Outcome(task.name, f"it was done on {outcome.worker}, but its files are not in "
                           f"{self._results} here: --out must be a folder that all machines of "
                           "the cluster share")
        return outcome

    def _seen(self, task: Task) -> bool:
        """Whether a task's files are here; a network's folder may show them late."""
        end = time.monotonic() + _PATIENCE
        while finished(task, self._results) is None:
            if time.monotonic() > end:
                return False
            time.sleep(0.2)
        return True

    def close(self) -> None:
        """Leave the cluster: what still runs is given up."""
        for reference in self._running:
            self._ray.cancel(reference, force=True)
        self._ray.shutdown()
