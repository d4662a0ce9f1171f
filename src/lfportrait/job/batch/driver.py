"""Run a batch: plan it, have its tasks run (`lfportrait.runner`), report the results.

The plan has sitter after sitter, so that portraits are finished one by one and not all at the end.

On this machine the processes that do tasks stay: each imports the package and reads the kernels
once. One that dies (killed, out of memory) breaks nothing but its own task: it is replaced, and the
task given out again. When the batch itself is killed they end, too, wherever they are.

Ray places tasks by the cores and the memory that they declare, and gives them out again where a
process or a machine dies. Files are not its business: all machines see the results and the photos
under the same paths (NFS or another shared folder). A machine needs the package and nothing else.
"""

from __future__ import annotations

import contextlib
import functools
import html
import logging
import os
import socket
import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

from ... import models
from ...cache import StageFolder, check_writable
from ...device import checked_choice
from ...errors import UserError
from ...example import Exemplar
from ...files import lock, write_bytes, write_json
from ...measure import THREADS, cost_of, free_memory_bytes, usable_cores
from ...runner import (
    Child,
    Failure,
    Outcome,
    Plan,
    Runner,
    Workers,
    finished,
    outcome_of,
    run_tasks,
    serve,
)
from ...simd.host import compiling_progress
from ...version import __version__
from ..graph import Task, painting_key, source_key
from ..made_from import MadeFrom
from ..pipeline import get_networks, networks_of
from ..warmup import Warmup
from ..work import Tools, do_stage
from .jobs_file import load_jobs
from .journal import FOLDER, Journal, Watcher, locked
from .plan import Batch, Fingerprints, cores_of_a_task, draw_plan

ATTEMPTS = 3  # How often a task is given out whose worker dies.
KERNELS = ("reconstruct", "transfer", "stylize", "encode")  # What tasks need compiled.
_MEMORY_SHARE = 0.85  # Part of the free memory that tasks may take together.


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

    A sitter's photos are another matter: they are in ``plan.refused``.
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
        found.learn(plan.tasks[name].stage, finished(plan.tasks[name], results) or {})
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
    path : The file of jobs (`load_jobs`).
    results : Folder for all results. A batch that was interrupted is resumed there, one that was
        changed does what is new.
    config : Where and how.
    offline : Download no networks.
    quiet : Print no progress of what comes before the first task.
    watchers : Called with each event (`lfportrait.job.batch.journal`).
    device : Where tasks compute, a choice of ``--device``; each machine of a cluster finds its
        own.

    Returns
    -------
    figures : Tasks, what failed and why (``failed``), what was done in this run (``ran``),
        ``jobs``.
    """
    config = config or BatchConfig()
    found = prepare_batch(path, results, made_from=config.made_from, offline=offline, quiet=quiet)
    with locked(results):
        return _Run(found, config, quiet, watchers or [], checked_choice(device)).run()


class _Run:
    """One run of a batch."""

    def __init__(self, found: Batch, config: BatchConfig, quiet: bool,
                 watchers: list[Watcher], device: str) -> None:
        self.batch, self.config, self.quiet = found, config, quiet
        self.left = [replace(task, device=device) for task in found.plan.to_do(found.done)]
        self.ran: Counter[str] = Counter()
        self.journal = Journal(found.results, watchers)

    def run(self) -> dict[str, Any]:
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
                found.lost |= run_tasks(
                    self.left, runner, self._heard,
                    lambda task: found.costs.need(task.stage).memory)
            figures = self._figures()
            self.journal.tell("end", done=len(found.done), failed=found.failures())
        self._write(figures)
        return figures

    def _runner(self) -> Runner[Task]:
        config, results = self.config, self.batch.results
        if config.on != "local":

            return RayRunner(config.on, results, config.cores, config.workers)
        self._compile()
        cores = config.cores or cores_of_a_task(self.batch.plan, usable_cores())
        return LocalRunner(results, cores, config.workers, results / FOLDER / "workers.log")

    def _compile(self) -> None:
        """The kernels, once for all workers."""
        with compiling_progress("kernels", enabled=not self.quiet) as progress, Warmup(
                KERNELS) as warmup:
            warmup.wait(KERNELS, progress)

    def _heard(self, task: Task, outcome: Outcome | None) -> None:
        """Note that a task begins, or how it ended."""
        found = self.batch
        if outcome is None:
            self.journal.tell("started", task=task.name, stage=task.stage)
            return
        if not outcome.error:
            figures = outcome.figures
            found.done.add(task.name)
            found.learn(task.stage, figures)
            self.ran[task.stage] += not outcome.again
            self.journal.tell("done", task=task.name, stage=task.stage, worker=outcome.worker,
                              **figures.get("cost", {}), notes=figures.get("notes", []))
            return
        found.failed[task.name] = outcome.error
        self.journal.tell("failed", task=task.name, stage=task.stage, why=outcome.error,
                          worker=outcome.worker)
        if outcome.fault:
            faults = found.results / FOLDER / "faults.txt"
            with contextlib.suppress(OSError), open(faults, "a", encoding="utf-8") as stream:
                stream.write(f"{task.name}\n{outcome.fault}\n")

    def _figures(self) -> dict[str, Any]:
        found = self.batch
        return {"tasks": len(found.plan.tasks), "done": len(found.done),
                "ran": dict(self.ran), "failed": found.failures(), "jobs": found.jobs_table()}

    def _write(self, figures: dict[str, Any]) -> None:
        """``results.json`` and ``index.html``; a full disk is only reported."""
        try:
            write_json(self.batch.results / "results.json", figures)
            write_bytes(self.batch.results / "index.html", write_index(self.batch).encode())
        except UserError as error:
            figures["failed"]["index.html"] = str(error)


def _plan_rows(plan: Plan[Task]) -> dict[str, Any]:
    """What ``lfportrait batch status`` must know of a plan."""
    return {"refused": plan.refused, "tasks": [
        {"name": task.name, "stage": task.stage, "folder": task.folder, "record": task.record,
         "outputs": task.outputs, "key": task.key, "needs": task.needs}
        for task in plan.tasks.values()]}


def write_index(batch: Batch) -> str:
    """The page, HTML, of a batch as it is now."""
    template = Template((resources.files(__package__) / "index.html").read_text("utf-8"))
    failures = batch.failures()
    sitters = [_sitter(batch, name) for name in batch.jobs.sitters if name not in
               batch.plan.refused]
    made = sum(row["state"] == "done" for row in batch.jobs_table())
    rows = "".join(f"<li><b>{html.escape(name)}</b> {html.escape(why)}</li>"
                   for name, why in failures.items())
    failed = f'<section class="failed"><h2>Failed</h2><ul>{rows}</ul></section>' if rows else ""
    return template.substitute(
        made=made, wanted=len(batch.jobs_table()), failed=len(failures), version=__version__,
        failures=failed, sitters="\n".join(sitters))


def _sitter(batch: Batch, name: str) -> str:
    """A sitter: a photo, figures, and the portraits."""
    tasks = [task for task in batch.plan.tasks.values() if task.sitter == name]
    notes: list[str] = []
    figures = []
    for task in tasks:
        found = (finished(task, batch.results) or {}) if task.name in batch.done else {}
        if task.stage == "capture" and found:
            figures.append(f"{found.get('views', 0)} photos")
            notes += found.get("notes", [])
        if task.stage == "field" and found.get("test"):
            figures.append(f"held-out views {found['test']['psnr']:.1f} dB")
        if task.stage == "field" and "voxels" in found:
            figures.append(f"{found['voxels'] / 1e6:.2f} M voxels")
    photo = _picture(f"{name}/photo.jpg", name) if f"{name}/capture" in batch.done else ""
    styles = dict.fromkeys(task.folder for task in tasks if "/" in task.folder)
    cards = "".join(_card(batch, folder, [task for task in tasks if task.folder == folder])
                    for folder in styles)
    remarks = "".join(f'<p class="note">{html.escape(note)}</p>' for note in notes)
    return (f'<section><h2>{html.escape(name)}</h2><p class="figures">'
            f'{html.escape(", ".join(figures))}</p>{remarks}'
            f'<div class="cards"><figure>{photo}<figcaption>photo</figcaption></figure>'
            f'{cards}</div></section>')


def _card(batch: Batch, folder: str, tasks: list[Task]) -> str:
    """A portrait: what it looks like and where its files are."""
    style = folder.partition("/")[2]
    page = next((task for task in tasks if task.stage == "page"), None)
    styled = next(task for task in tasks if task.stage == "stylize")
    picture = _picture(f"{folder}/thumbnail.jpg", style) if styled.name in batch.done else ""
    if page is not None and page.name in batch.done and picture:
        picture = f'<a href="{quote(folder)}/portrait.html">{picture}</a>'
    links = [_link(batch, task) for task in tasks if task.stage in ("encode", "page", "sweep")]
    return (f"<figure>{picture}<figcaption><b>{html.escape(style)}</b>"
            f"<ul>{''.join(links)}</ul></figcaption></figure>")


def _link(batch: Batch, task: Task) -> str:
    """A file, or why it is not there."""
    label = html.escape(task.label)
    if task.name not in batch.done:
        cause = batch.lost.get(task.name, task.name)
        why = batch.failed.get(cause, "not made yet")
        return f'<li class="failed">{label}: {html.escape(why)}</li>'
    found: dict[str, Any] = finished(task, batch.results) or {}
    size = found.get("cost", {}).get("bytes", 0) / 1e6
    return (f'<li><a href="{quote(f"{task.folder}/{task.outputs[0]}")}">{label}</a> '
            f"{size:.1f} MB</li>")


def _picture(path: str, words: str) -> str:
    return f'<img src="{quote(path)}" alt="{html.escape(words)}" loading="lazy" height="192">'


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
            lambda _: Child("lfportrait.job.batch.driver:serve_batch", log, settings),
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
