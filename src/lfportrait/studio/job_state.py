"""A job as the page sees it: its stages, how far it is and how long the rest takes.

A job's state lies in a small file, so that a server that is started again goes on with what was
running.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..files import read_json, write_json

__all__ = ["ENDED", "JobState", "StageState", "load_jobs"]

ENDED = ("done", "failed", "cancelled")


@dataclass
class StageState:
    """One stage of a job.

    Attributes
    ----------
    name
        Fixed, for the page.
    state
        ``waiting``, ``running``, ``done``, ``failed`` or ``skipped``.
    progress
        0 to 1, or None where it is not known.
    note
        What is being done, in English.
    seconds
        It has taken so far.
    need
        It will take, as far as is known.
    pictures
        How often it was drawn.
    pages
        How often a page was written that turns the head as far as it is made.
    begun
        When it began, in seconds since 1970.
    """

    name: str
    state: str = "waiting"
    progress: float | None = None
    note: str = ""
    seconds: float = 0.0
    need: float = 0.0
    pictures: int = 0
    pages: int = 0
    begun: float = 0.0

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
    """One job.

    Attributes
    ----------
    id, kind, project, version, export
        What is done, for whom.
    state
        ``waiting``, ``running``, ``paused``, ``done``, ``failed``, ``cancelled`` or ``stopped``.
    order
        What the process needs to know beside that.
    after
        Id of the job whose end it waits for, or None.
    created, started, ended
        In seconds since 1970.
    stages
        In their order.
    notes
        Warnings.
    error
        Code and message of a failure.
    result
        What the process said at its end.
    """

    id: str
    kind: str
    project: str | None = None
    version: str | None = None
    export: str | None = None
    name: str = ""
    state: str = "waiting"
    order: dict[str, Any] = field(default_factory=dict)
    after: str | None = None
    created: float = 0.0
    started: float | None = None
    ended: float | None = None
    stages: list[StageState] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    error: dict[str, str] | None = None
    result: dict[str, Any] | None = None

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
