"""Run a batch: plan it, start tasks when their inputs are done, report the results.

There is no schedule but the graph. Of the tasks whose needs are done the first of the plan goes
first; the plan has sitter after sitter, so that portraits are finished one by one and not all at
the end.
"""

from __future__ import annotations

import contextlib
import heapq
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ... import models
from ...device import checked_choice
from ...errors import UserError
from ...example import Exemplar
from ...files import atomic_write, write_json
from ...measure import usable_cores
from ...simd.host import compiling_progress
from ...stages import check_writable
from ..few_photos import MadeFrom
from ..graph import Plan, Task, finished
from ..networks import get_networks, networks_of
from ..steps import painting_key, source_key
from ..warmup import Warmup
from .costs import cores_of_a_task
from .fingerprints import Fingerprints
from .index import write_index
from .jobs_file import load_jobs
from .journal import FOLDER, Journal, Watcher, locked
from .plan import draw_plan
from .runners import KERNELS, LocalRunner, Runner
from .state import Batch
from .work import Outcome

__all__ = ["BatchConfig", "batch", "prepare_batch"]


@dataclass(frozen=True)
class BatchConfig:
    """How a batch is run."""

    on: str = "local"
    """local: processes on this machine; ray: a Ray cluster that runs here or at RAY_ADDRESS,
    otherwise a new one on this machine; ray://HOST:PORT: a remote cluster."""
    workers: int = 0
    """Number of parallel tasks; 0: as many as cores and memory allow."""
    cores: int = 0
    """Cores per task; 0: one, or more if there are fewer sitters than cores. Results depend on it
    in their last bits."""
    made_from: MadeFrom = "auto"
    """Fit a head to the face (face), or find cameras by what the photos share (photos), for all
    sitters of which the jobs file says neither; auto: as `lfportrait make` does."""


def prepare_batch(path: Path, results: Path, *, made_from: MadeFrom = "auto",
                  offline: bool = False, quiet: bool = True) -> Batch:
    """Read a jobs file, plan its tasks and find the finished ones; nothing is written.

    Parameters
    ----------
    path
        The file (`load_jobs`).
    results
        Folder for all results.
    made_from
        As `BatchConfig.made_from`.
    offline
        Download no networks.
    quiet
        Print no progress.

    Raises
    ------
    UserError
        If the file, a painting or a display can't be used. A sitter's photos are another matter:
        they are in ``plan.refused``.
    """
    jobs = load_jobs(path)
    if jobs.config.made_from == "auto":
        jobs = replace(jobs, config=replace(jobs.config, made_from=made_from))
    check_writable(results)
    paintings = {}
    for style in jobs.styles.values():
        picture = Path(style.painting)
        if picture.is_file() and not picture.with_suffix(".landmarks.txt").exists():
            models.require(["face-landmarker"], download=not offline, purpose=f"{picture}, which "
                           "has no landmarks beside it", quiet=quiet)
        try:
            paintings[style.name] = painting_key(Exemplar.load(style.painting))
        except UserError as error:
            raise UserError(f"{path}: style {style.name}: painting: {error}") from error
    prints = Fingerprints(results / FOLDER / "photos.json", source_key)
    plan = draw_plan(jobs, paintings, prints)
    done = plan.done(results)
    found = Batch(jobs, plan, results, done, prints=prints)
    _ask_for_networks(found, offline, quiet)
    for name in done:
        found.estimates.learn(plan.tasks[name].stage, finished(plan.tasks[name], results) or {})
    return found


def _ask_for_networks(found: Batch, offline: bool, quiet: bool) -> None:
    """The networks of all captures and methods that are to be used, before the first long task."""
    for task in found.plan.to_do(found.done):
        if task.stage == "stylize":
            style = task.config.stylize
            models.require(style.networks, download=not offline, quiet=quiet,
                           purpose=f"--method {style.method}")
        if task.stage == "capture":
            photos, keep = Path(task.source), task.config.keep_background
            try:
                networks_of(photos, None, keep)
            except UserError:  # a file of this sitter is damaged: the task will report it
                continue
            get_networks(photos, None, keep, offline=offline, quiet=quiet)


def batch(path: Path, results: Path, config: BatchConfig | None = None, *, offline: bool = False,
          quiet: bool = True, watchers: list[Watcher] | None = None,
          device: str = "auto") -> dict[str, Any]:
    """Make all portraits of a jobs file.

    Parameters
    ----------
    path
        The file of jobs (`load_jobs`).
    results
        Folder for all results. A batch that was interrupted is resumed there, one that was changed
        does what is new.
    config
        Where and how.
    offline
        Download no networks.
    quiet
        Print no progress of what comes before the first task.
    watchers
        Called with each event (`lfportrait.job.batch.journal`).
    device
        Where tasks compute, a choice of ``--device``; each machine of a cluster finds its own.

    Returns
    -------
    figures
        Tasks, what failed and why (``failed``), what was done in this run (``ran``), ``jobs``.
    """
    config = config or BatchConfig()
    found = prepare_batch(path, results, made_from=config.made_from, offline=offline, quiet=quiet)
    with locked(results):
        return _Run(found, config, quiet, watchers or [], checked_choice(device)).run()


class _Left:
    """The tasks that are left, those first whose needs are done, in the order of the plan."""

    def __init__(self, tasks: list[Task]) -> None:
        self._tasks = {task.name: task for task in tasks}
        self._place = {task.name: place for place, task in enumerate(tasks)}
        self._lacks = {task.name: {need for need in task.needs if need in self._tasks}
                       for task in tasks}
        self._followers: dict[str, list[str]] = {}
        for task in tasks:
            for need in self._lacks[task.name]:
                self._followers.setdefault(need, []).append(task.name)
        # In order, so a heap already.
        self._ready = [place for place, task in enumerate(tasks) if not self._lacks[task.name]]
        self._order = tasks

    def __len__(self) -> int:
        """Tasks that have not ended."""
        return len(self._tasks)

    def first(self) -> Task | None:
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


class _Run:
    """One run of a batch."""

    def __init__(self, found: Batch, config: BatchConfig, quiet: bool,
                 watchers: list[Watcher], device: str) -> None:
        self.batch, self.config, self.quiet, self.device = found, config, quiet, device
        self.left = _Left(found.plan.to_do(found.done))
        self.ran: Counter[str] = Counter()
        self.journal = Journal(found.results, watchers)

    def run(self) -> dict[str, Any]:
        """Do all that is left."""
        found = self.batch
        write_json(found.results / FOLDER / "plan.json", _plan_rows(found.plan))
        if found.prints is not None:
            found.prints.keep()
        with contextlib.ExitStack() as stack:
            stack.callback(self.journal.close)
            runner = None
            if self.left:
                runner = self._runner()
                stack.callback(runner.close)
            self.journal.tell("plan", **found.summary(), slots=runner.slots if runner else 0)
            for name, why in found.plan.refused.items():
                self.journal.tell("failed", task=name, why=why)
            if runner is not None:
                self._work(runner)
            figures = self._figures()
            self.journal.tell("end", done=len(found.done), failed=found.failures())
        self._write(figures)
        return figures

    def _runner(self) -> Runner:
        config, results = self.config, self.batch.results
        if config.on != "local":
            from .ray_runner import RayRunner

            return RayRunner(config.on, results, config.cores, config.workers)
        self._compile()
        cores = config.cores or cores_of_a_task(self.batch.plan, usable_cores())
        return LocalRunner(results, cores, config.workers, results / FOLDER / "workers.log")

    def _compile(self) -> None:
        """The kernels, once for all workers."""
        with compiling_progress("kernels", enabled=not self.quiet) as progress, Warmup(
                KERNELS) as warmup:
            warmup.wait(KERNELS, progress)

    def _work(self, runner: Runner) -> None:
        """Give out tasks and take in outcomes until none is left."""
        while self.left:
            while (task := self.left.first()) is not None:
                memory = self.batch.estimates.need(task.stage).memory
                if not runner.fits(memory):
                    break
                self.left.take()
                self.journal.tell("started", task=task.name, stage=task.stage)
                runner.start(replace(task, device=self.device), memory)
            for outcome in runner.wait(0.5):
                self._take(outcome)

    def _take(self, outcome: Outcome) -> None:
        """Note how a task ended."""
        found, task = self.batch, self.batch.plan.tasks[outcome.task]
        if not outcome.error:
            figures = outcome.figures or {}
            found.done.add(task.name)
            self.left.done(task.name)
            found.estimates.learn(task.stage, figures)
            self.ran[task.stage] += not outcome.again
            self.journal.tell("done", task=task.name, stage=task.stage, worker=outcome.worker,
                              **figures.get("cost", {}), notes=figures.get("notes", []))
            return
        found.failed[task.name] = outcome.error
        self.journal.tell("failed", task=task.name, stage=task.stage, why=outcome.error,
                          worker=outcome.worker)
        if outcome.fault:
            faults = found.results / FOLDER / "faults.txt"
            with suppress(OSError), open(faults, "a", encoding="utf-8") as stream:
                stream.write(f"{task.name}\n{outcome.fault}\n")
        found.lost |= dict.fromkeys(self.left.failed(task.name), task.name)

    def _figures(self) -> dict[str, Any]:
        found = self.batch
        return {"tasks": len(found.plan.tasks), "done": len(found.done),
                "ran": dict(self.ran), "failed": found.failures(), "jobs": found.jobs_table()}

    def _write(self, figures: dict[str, Any]) -> None:
        """``results.json`` and ``index.html``; a full disk is only reported."""
        try:
            write_json(self.batch.results / "results.json", figures)
            with atomic_write(self.batch.results / "index.html") as stream:
                stream.write(write_index(self.batch).encode())
        except UserError as error:
            figures["failed"]["index.html"] = str(error)


def _plan_rows(plan: Plan) -> dict[str, Any]:
    """What ``lfportrait batch status`` must know of a plan."""
    return {"refused": plan.refused, "tasks": [
        {"name": task.name, "stage": task.stage, "folder": task.folder, "record": task.record,
         "outputs": task.outputs, "key": task.key, "needs": task.needs}
        for task in plan.tasks.values()]}
