"""The queue of jobs: heavy ones one after the other, light ones beside them, each a process.

A job is one task of a schedule (`lfportrait.runner`), which runs it; here is only what is known of
it, and what the page asks for. All of it is in the server's loop. A job's process tells what it
does (`lfportrait.studio.work`); one that was killed can go on where its last stage ended.

What it is asked for is an `Order`: paths and choices, and the parameters that they stand for. The
server writes it, and imports nothing that is slow.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..cache import fingerprint_files
from ..errors import UserError
from ..files import read_json, write_json
from ..lightfield import Display
from ..models import OFFLINE
from ..runner import Callbacks, Child, Costs, Failure, Need, Outcome, Schedule, Task, Workers
from .answers import Events, Refusal, read_error

if TYPE_CHECKING:
    from ..job import MakeConfig

ENDED = ("done", "failed", "cancelled")


@dataclass
class StageState:
    """One stage of a job."""

    name: str  # Fixed, for the page.
    state: str = "waiting"  # ``waiting``, ``running``, ``done``, ``failed`` or ``skipped``.
    progress: float | None = None  # 0 to 1, or None where it is not known.
    note: str = ""  # What is being done, in English.
    seconds: float = 0.0  # It has taken so far.
    need: float = 0.0  # It will take, as far as is known.
    pictures: int = 0  # How often it was drawn.
    pages: int = 0  # How often a page was written that turns the head as far as it is made.
    begun: float = 0.0  # When it began, in seconds since 1970.

    def left(self, spent: float, pace: float = 1.0) -> float:
        """Seconds that it will go on, after so many; ``pace`` counts where it waits."""
        if self.state == "waiting":
            return self.need * pace
        if self.state != "running":
            return 0.0
        if self.progress is not None and self.progress > 0.02:
            return spent / self.progress - spent
        return max(self.need - spent, 0.0)


@dataclass
class JobState:
    """One job: what is done, for whom; times are in seconds since 1970."""

    id: str
    kind: str
    project: str | None = None
    version: str | None = None
    export: str | None = None
    name: str = ""
    # ``waiting``, ``running``, ``paused``, ``done``, ``failed``, ``cancelled`` or ``stopped``.
    state: str = "waiting"
    order: dict[str, Any] = field(default_factory=dict)  # What the process needs to know, too.
    after: str | None = None  # Id of the job whose end it waits for.
    created: float = 0.0
    started: float | None = None
    ended: float | None = None
    stages: list[StageState] = field(default_factory=list)  # In their order.
    notes: list[str] = field(default_factory=list)  # Warnings.
    error: dict[str, str] | None = None  # Code and message of a failure.
    result: dict[str, Any] | None = None  # What the process said at its end.

    @property
    def heavy(self) -> bool:
        """Whether it takes all cores, so that such jobs run one after the other."""
        return self.kind in ("head", "fine")

    @property
    def over(self) -> bool:
        """Whether it has ended."""
        return self.state in ENDED

    def stage(self, name: str) -> StageState:
        """A stage by its name; one that was not foretold is added."""
        for one in self.stages:
            if one.name == name:
                return one
        self.stages.append(StageState(name))
        return self.stages[-1]

    def spent(self, stage: StageState) -> float:
        """Seconds that a stage has taken so far; while the job is paused they do not grow."""
        running = stage.state == "running" and self.state == "running"
        return time.time() - stage.begun if running else stage.seconds

    def pace(self) -> float:
        """How much longer than expected its stages take, 1 or more.

        A machine that is busy, or slower than was thought, is so for the stages that wait, too.
        """
        began = [one for one in self.stages if one.need > 0 and one.state in ("running", "done")]
        if not began:
            return 1.0
        took = sum(self.spent(one) + one.left(self.spent(one)) for one in began)
        return max(1.0, took / sum(one.need for one in began))

    def left_of(self, stage: StageState) -> float:
        """Seconds that a stage will go on."""
        return round(stage.left(self.spent(stage), self.pace()), 1)

    def left(self) -> float | None:
        """Seconds to its end; None before its stages are known."""
        if not self.stages:
            return None
        return round(sum(map(self.left_of, self.stages)), 1)

    def progress(self) -> float | None:
        """How much of it is done, 0 to 1, by time."""
        left = self.left()
        if self.state == "done" or left is None:
            return 1.0 if self.state == "done" else None
        spent = sum(map(self.spent, self.stages))
        return round(spent / max(spent + left, 1e-6), 4)

    def entry(self, place: int) -> dict[str, Any]:
        """As the page sees it; ``place`` is its place in the queue, 0 is next."""
        stages = [{
            "name": one.name, "title": one.name, "state": one.state, "note": one.note,
            "progress": None if one.progress is None else round(one.progress, 4),
            "seconds": round(self.spent(one), 1),
            "left": self.left_of(one) if not self.over else 0.0,
            "picture": f"/api/jobs/{self.id}/stages/{one.name}/picture?v={one.pictures}"
            if one.pictures else None,
            "page": f"/api/jobs/{self.id}/stages/{one.name}/page?v={one.pages}"
            if one.pages else None} for one in self.stages]
        return {"id": self.id, "kind": self.kind, "project": self.project, "name": self.name,
                "version": self.version, "title": self.order.get("title"),
                "export": self.export, "state": self.state,
                "quality": self.order.get("quality"), "after": self.after, "place": place,
                "created": self.created, "started": self.started, "ended": self.ended,
                "stages": stages, "progress": self.progress(),
                "left": None if self.over else self.left(), "notes": self.notes,
                "error": self.error, "result": self.result}

    def save(self, folder: Path) -> None:
        """Write the state into the folder of jobs."""
        write_json(folder / f"{self.id}.json", asdict(self))


def load_jobs(folder: Path) -> list[JobState]:
    """The jobs of earlier runs, in their order; what was running then is ``stopped``."""
    found = []
    for path in folder.glob("j-*.json"):
        try:
            data = read_json(path)
            job = JobState(**{**data, "stages": [StageState(**one) for one in data["stages"]]})
        except (UserError, TypeError, KeyError):
            continue
        if job.state in ("running", "paused"):
            job.state = "stopped"
        for one in job.stages:
            if one.state == "running":
                one.state, one.progress = "waiting", None
        found.append(job)
    return sorted(found, key=lambda job: (job.created, job.id))


_KEPT = 100
_LIGHT = 2  # Light jobs that run at once.
_NOTES = 20
_KILLED = Failure("killed", "the job's process was ended from outside, as it happens where memory "
                  "is short: close other programs, then let it go on; what is finished is kept")

OrderMaker = Callable[[JobState], Any]
"""Makes what a job's process is sent; raises a `Refusal` where something is missing."""


class Jobs:
    """All jobs of a studio: their states, logs and pictures in a folder; events tell every change.

    ``order`` makes what a job's process is sent; ``changed`` is called with a job whose stage or
    state has changed, for what depends on it.
    """

    ENTRY = "lfportrait.studio.work.jobs:serve"
    """What a job's process runs."""

    def __init__(self, folder: Path, events: Events, order: OrderMaker,
                 changed: Callable[[JobState], None] = lambda job: None) -> None:
        self._folder, self._events, self._order, self._changed = folder, events, order, changed
        folder.mkdir(parents=True, exist_ok=True)
        self.jobs: dict[str, JobState] = {job.id: job for job in load_jobs(folder)}
        self._costs = Costs(file=folder / "costs.json")
        self._runner = Workers[Task](
            1 + _LIGHT, self._process, lambda task: order(self.jobs[task.name]), _KILLED,
            stay=False, callbacks=Callbacks(self._hear, self._wake, read_error))
        self._children = self._runner.children
        self._schedule = Schedule(
            self._runner, self._heard, self._lost,
            lane=lambda task: "heavy" if self.jobs[task.name].heavy else "light",
            at_once={"heavy": 1, "light": _LIGHT})
        self._loop: asyncio.AbstractEventLoop | None = None  # while it runs
        self._places: dict[str, int] = {}  # that the pages know

    # -- asked by the page ------------------------------------------------------------------------

    def get(self, name: str) -> JobState:
        """A job by its id."""
        if name not in self.jobs:
            raise Refusal("not_found", "there is no such job any more")
        return self.jobs[name]

    def entries(self) -> list[dict[str, Any]]:
        """All jobs as the page sees them, in their order."""
        return [self.entry(job) for job in self.jobs.values()]

    def entry(self, job: JobState) -> dict[str, Any]:
        """A job as the page sees it."""
        return job.entry(self._queue().get(job.id, 0))

    def _queue(self) -> dict[str, int]:
        """Places of the heavy jobs that wait, by their ids; 0 is next."""
        waiting = (one.id for one in self.jobs.values() if one.heavy and one.state == "waiting")
        return {name: place for place, name in enumerate(waiting)}

    def of(self, project: str, kind: str = "") -> JobState | None:
        """The job that runs or waits for a project, the first one if there are several."""
        return next((job for job in self.jobs.values() if job.project == project and not job.over
                     and (job.kind == kind if kind else job.heavy)), None)

    def add(self, kind: str, project: str | None, name: str, **more: Any) -> JobState:
        """A new job, at the end of the queue."""
        job = JobState(f"j-{secrets.token_hex(4)}", kind, project, name=name,
                       created=round(time.time(), 3), **more)
        self._order(job)  # what is missing is said now
        self.jobs[job.id] = job
        self._keep(job)
        self._forget()
        self._submit(job)
        return job

    def waits(self, job: JobState) -> bool:
        """Whether a job must wait for the end of another one."""
        other = self.jobs.get(job.after or "")
        return other is not None and not other.over

    async def cancel(self, job: JobState) -> None:
        """End a job; finished stages stay."""
        if job.over:
            return
        job.state, job.ended = "cancelled", round(time.time(), 3)
        child = self._runner.stop(job.id)
        if child is not None:
            await asyncio.to_thread(child.close)
        self._schedule.end(Outcome(job.id, "it was cancelled"))
        self._schedule.give()

    def pause(self, job: JobState) -> None:
        """Stop a job where it is; its memory stays, and the next one does not begin."""
        child = self._children.get(job.id)
        if job.state != "running" or child is None:
            raise Refusal("busy", "only a job that runs can be paused")
        child.pause(True)
        job.state = "paused"
        for one in job.stages:
            if one.state == "running":
                one.seconds = time.time() - one.begun
        self._keep(job)

    def resume(self, job: JobState) -> None:
        """Let a job go on: one that is paused, or has failed or was cancelled."""
        child = self._children.get(job.id)
        if job.state == "paused" and child is not None:
            for one in job.stages:
                if one.state == "running":
                    one.begun = time.time() - one.seconds
            job.state = "running"
            child.pause(False)
            self._keep(job)
        elif job.state in ("failed", "cancelled") and job.id not in self._schedule:
            self._order(job)
            job.state, job.error, job.ended, job.notes = "waiting", None, None, []
            job.stages = [StageState(one.name, need=one.need) for one in job.stages]
            self._keep(job)
            self._submit(job)
        else:
            raise Refusal("busy", "this job runs or waits already")

    def move(self, job: JobState, place: int) -> None:
        """Put a waiting job at a place of the queue."""
        waiting = [one for one in self.jobs.values() if one.heavy and one.state == "waiting"]
        if job not in waiting:
            raise Refusal("busy", "only a job that waits can be moved")
        waiting.remove(job)
        waiting.insert(max(0, place), job)
        others = [one for one in self.jobs.values() if one not in waiting]
        times = sorted(one.created for one in waiting)
        for one, created in zip(waiting, times, strict=True):
            one.created = created
            self._schedule.move(one.id, created)
        self.jobs = {one.id: one for one in (*others, *waiting)}
        for one in waiting:
            self._keep(one)

    def remove(self, job: JobState) -> None:
        """Take a job that has ended from the list."""
        if not job.over:
            raise Refusal("busy", "cancel the job first")
        del self.jobs[job.id]
        (self._folder / f"{job.id}.json").unlink(missing_ok=True)
        (self._folder / f"{job.id}.log").unlink(missing_ok=True)
        shutil.rmtree(self.pictures(job), ignore_errors=True)
        self._events.tell("job-removed", {"job": job.id})

    def pictures(self, job: JobState) -> Path:
        """Folder of a job's pictures."""
        return self._folder / job.id

    # -- running ----------------------------------------------------------------------------------

    def start(self) -> None:
        """Go on with what an earlier run of the server left."""
        self._loop = asyncio.get_running_loop()
        left = [job for job in self.jobs.values() if not job.over]
        for job in sorted(left, key=self.waits):  # after those that they wait for
            job.state = "waiting"
            self._submit(job, give=False)
        self._schedule.give()

    async def close(self) -> None:
        """End all processes; what ran goes on with the next run of the server."""
        self._loop = None
        for name in self._children:
            self.jobs[name].state = "stopped"
            self._keep(self.jobs[name])
        await asyncio.to_thread(self._runner.close)

    def _submit(self, job: JobState, *, give: bool = True) -> None:
        """Have a job run when its turn comes."""
        needs = () if job.after is None else (job.after,)
        self._schedule.add(Task(job.id, job.kind, "", (), "", needs), job.created)
        if give:
            self._schedule.give()

    def _process(self, task: Task) -> Child:
        return Child(self.ENTRY, self._folder / f"{task.name}.log",
                     {} if task.stage == "networks" else {OFFLINE: "1"}, group=True)

    def _wake(self) -> None:
        """Take in what processes say, in the server's loop."""
        loop = self._loop
        if loop is not None:
            with contextlib.suppress(RuntimeError):  # it has ended
                loop.call_soon_threadsafe(self._take_in)

    def _take_in(self) -> None:
        if self._loop is not None:
            self._schedule.step()

    def _lost(self, task: Task, _: str) -> None:
        """What a job waited for was not done: it begins, and says what it lacks."""
        self._schedule.add(replace(task, needs=()), self.jobs[task.name].created)

    def _heard(self, task: Task, outcome: Outcome | None) -> None:
        """A job begins, or has ended."""
        job = self.jobs.get(task.name)
        if job is None:  # it was cancelled and taken from the list
            return
        if outcome is None:
            job.state, job.started = "running", job.started or round(time.time(), 3)
        elif job.state != "cancelled" and outcome.error:
            self._fail(job, outcome.code, outcome.error)
        elif job.state != "cancelled":
            job.state, job.result, job.ended = "done", outcome.figures, round(time.time(), 3)
        for one in job.stages:
            if job.over and one.state == "running":
                one.state, one.seconds = "waiting", round(time.time() - one.begun, 1)
        self._keep(job)

    def _hear(self, task: Task, message: tuple[Any, ...]) -> None:
        job, kind, facts = self.jobs[task.name], message[0], message[1:]
        if kind == "progress":
            self._progress(job, *facts)
            return
        if kind == "stages":
            known = {one.name: one for one in job.stages}
            job.stages = []
            for name, usual in facts[0]:
                one = known.get(name) or StageState(name)
                self._costs.usual[name] = Need(usual)
                one.need = self._costs.need(name).seconds
                job.stages.append(one)
        elif kind == "note":
            if facts[0] not in job.notes:
                job.notes = [*job.notes, facts[0]][-_NOTES:]
        else:
            self._stage(kind, job.stage(facts[0]), facts)
        self._keep(job)

    def _stage(self, kind: str, stage: StageState, facts: tuple[Any, ...]) -> None:
        if kind == "begin":
            stage.state, stage.progress, stage.note = "running", None, ""
            stage.begun = time.time()
        elif kind == "picture":
            stage.pictures += 1
        elif kind == "page":
            stage.pages += 1
        elif kind == "done":
            stage.state, stage.progress, stage.note = "done", 1.0, ""
            stage.seconds = facts[1]
            self._costs.learn(stage.name, Need(facts[1]))
        elif kind == "skipped":
            stage.state, stage.progress = "skipped", 1.0

    def _progress(self, job: JobState, name: str, share: float | None, note: str) -> None:
        stage = job.stage(name)
        stage.progress, stage.note = share, note
        self._events.tell("progress", {
            "job": job.id, "stage": name, "note": note,
            "progress": None if share is None else round(share, 4),
            "left": job.left_of(stage), "total_progress": job.progress(),
            "total_left": job.left(), "waiting": {
                one.name: job.left_of(one) for one in job.stages if one.state == "waiting"}},
            numbered=False)

    def _fail(self, job: JobState, code: str, message: str) -> None:
        job.state, job.ended = "failed", round(time.time(), 3)
        job.error = {"code": code, "message": message}
        for one in job.stages:
            if one.state == "running":
                one.state, one.seconds = "failed", round(time.time() - one.begun, 1)

    def _keep(self, job: JobState) -> None:
        """Write a job's state, and tell it; a full disk only loses the file."""
        with contextlib.suppress(UserError):
            job.save(self._folder)
        self._events.tell("job", self.entry(job))
        # Others have moved up when one begins, is cancelled or moved.
        before, self._places = self._places, self._queue()
        for name, place in self._places.items():
            if name != job.id and before.get(name) != place:
                self._events.tell("job", self.entry(self.jobs[name]))
        self._changed(job)

    def _forget(self) -> None:
        ended = [job for job in self.jobs.values() if job.over]
        for job in ended[:max(0, len(self.jobs) - _KEPT)]:
            self.remove(job)


def _words(config: Any, usual: Any, start: str) -> Iterator[str]:
    """Arguments for the fields of a data class that differ from another one's."""
    for one in fields(config):
        value, other = getattr(config, one.name), getattr(usual, one.name)
        name = f"{start}{one.name}".replace("_", "-")
        if value == other:
            continue
        if is_dataclass(value) and type(value) is type(other):
            yield from _words(value, other, f"{start}{one.name}.")
        elif isinstance(value, bool):
            path, _, last = name.rpartition(".")
            yield f"--{path}{'.' if path else ''}{'' if value else 'no-'}{last}"
        else:
            every = value if isinstance(value, tuple | list) else [value]
            yield from (f"--{name}", *map(str, every))


@dataclass(frozen=True)
class Order:
    """One job."""

    kind: str  # ``head``, ``fine``, ``check``, ``export`` or ``networks``.
    pictures: Path  # Folder for the stages' pictures.
    # folder, job, source: The project's, the job's (`lfportrait make --out`), and what the capture
    # is made of.
    folder: Path = Path()
    job: Path = Path()
    source: Path = Path()
    demo: bool = False  # Whether the built-in head is to be photographed first.
    # ``quick``, and ``parameters`` by their dotted names.
    options: dict[str, Any] = field(default_factory=dict)
    display: str = "generic-4k"  # A preset's name or a display file.
    # style, style_id, name: The painting (a picture or a built-in name), its id, and the project's
    # name.
    style: str = ""
    style_id: str = ""
    name: str = ""
    version: Path = Path()  # Folder of the version.
    # Arguments of `lfportrait.stylize.StyledField.mix`.
    mix: dict[str, Any] = field(default_factory=dict)
    more: dict[str, Any] = field(default_factory=dict)  # What else the kind needs.

    def panel(self) -> Display:
        """The display."""
        return Display.resolve(self.display)

    def config(self) -> MakeConfig:
        """The parameters of all stages, as `lfportrait make` has them for this display."""
        from ..job import fitted

        config = self.chosen()
        return fitted(config, [(self.panel(), config.encode)])

    def chosen(self) -> MakeConfig:
        """The parameters of all stages as they are given to `lfportrait make`."""
        from ..job import FULL, QUICK, MakeConfig
        from ..job.batch import overlaid

        quick = bool(self.options.get("quick"))
        config = QUICK.config if quick else FULL.config if self.demo else MakeConfig()
        nested: dict[str, Any] = {}
        for name, value in self.options.get("parameters", {}).items():
            place = nested
            *path, last = str(name).split(".")
            for part in path:
                place = place.setdefault(part, {})
                if not isinstance(place, dict):
                    raise UserError(f"there is no parameter {name}")
            place[last] = value
        return overlaid(config, nested, "options")

    def words(self) -> list[str]:
        """The parameters that differ from the usual ones, as arguments of `lfportrait make`."""
        from ..job import MakeConfig

        return list(_words(self.chosen(), MakeConfig(), ""))

    def inside(self, path: Path) -> str:
        """A path in the project's folder as tasks have it."""
        return path.relative_to(self.folder).as_posix() if path != self.folder else ""

    def inputs(self) -> dict[str, str]:
        """The files of the head that later stages read."""
        return {"capture": self.inside(self.job / "capture"),
                "field": self.inside(self.job / "field.npz")}

    def field_key(self) -> str:
        """Key of the field that is there, whatever it was made of."""
        try:
            return str(read_json(self.job / ".stages" / "reconstruct.json")["key"])
        except (UserError, KeyError, TypeError):
            return fingerprint_files([self.job / "field.npz"])
