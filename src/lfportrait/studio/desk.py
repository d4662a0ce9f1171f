"""The studio as a whole: its projects, queue, previews and gallery, and what ties them together."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..measure import free_disk_bytes
from . import exports
from .answers import Events, Refusal, truth
from .displays import Displays
from .jobs import Jobs, JobState, Order
from .photos import VIDEO_FRAME, Uploads, check_key, sheet
from .previews import Previews, Turn
from .projects import Project, Projects
from .styles import Styles
from .versions import Version, Versions, mix_arguments

_QUIET = 2.0  # Seconds without another upload after which photos are checked.
_LOW, _AGAIN = 2 << 30, 120.0
"""Free bytes below which the disk is nearly full, and seconds before it is said again."""


class Desk:
    """All parts of a studio."""

    def __init__(self, folder: Path) -> None:
        self.projects = Projects(folder)
        own = self.projects.own
        self.events = Events()
        self.styles = Styles(self.projects)
        self.displays = Displays(self.projects)
        self.uploads = Uploads()
        self.previews = Previews(own / "previews.log", self.events)
        self.jobs = Jobs(own / "jobs", self.events, self.order, self._changed)
        self.stop: Callable[[], None] = lambda: None
        self.wizard: dict[str, dict[str, Any]] = {}
        self._warned = -_AGAIN
        self._checks: dict[str, asyncio.TimerHandle] = {}
        self._tasks: set[asyncio.Task[Any]] = set()

    async def close(self) -> None:
        """End all processes."""
        for timer in self._checks.values():
            timer.cancel()
        self.events.close()
        await self.jobs.close()
        await self.previews.close()
        self.projects.close()

    # -- what the page sees -----------------------------------------------------------------------

    def project_entry(self, project: Project) -> dict[str, Any]:
        """A project with its job and its picture."""
        job = self.jobs.of(project.id)
        picture = self.thumbnail(project)
        address = None
        if picture is not None:
            address = f"/api/projects/{project.id}/thumbnail?v={picture.stat().st_mtime_ns:x}"
        return {**project.entry(), "job": job.id if job is not None else None, "thumbnail": address}

    def thumbnail(self, project: Project) -> Path | None:
        """A picture of a project: its last preview, its head, or its first photo."""
        for folder in ("versions", "previews", "."):
            found = sorted((project.own / folder).glob("*.jpg"),
                           key=lambda path: path.stat().st_mtime)
            if found:
                return found[-1]
        small = project.own / "small"
        found = sorted(small.glob("*-240.jpg")) or [*small.glob(VIDEO_FRAME)]
        return found[0] if found else None

    def photos(self, project: Project) -> dict[str, Any]:
        """The contact sheet, and how far its check is."""
        found = sheet(project)
        job = self.jobs.of(project.id, "check")
        if job is not None:
            stage = job.stages[0] if job.stages else None
            total = sum(not one["left_out"] for one in found["photos"])
            done = round((stage.progress or 0.0) * total) if stage is not None else 0
            found["checking"] = {"job": job.id, "done": done, "total": total}
        return found

    def version_entry(self, project: Project, version: Version) -> dict[str, Any]:
        """A version with its job."""
        job = self._making(project, version)
        return Versions(project).entry(version, None if job is None else job.id)

    def tell_project(self, project: Project, *more: str) -> None:
        """Tell the pages that a project has changed, and what of it."""
        with contextlib.suppress(OSError):
            self.events.tell("project", self.project_entry(project))
        for kind in more:
            self.events.tell(kind, {"project": project.id})

    # -- photos are checked by themselves ---------------------------------------------------------

    def check_soon(self, project: Project) -> None:
        """Check photos when nothing has come for two seconds."""
        before = self._checks.pop(project.id, None)
        if before is not None:
            before.cancel()
        loop = asyncio.get_running_loop()
        self._checks[project.id] = loop.call_later(_QUIET, self._check, project)

    def _check(self, project: Project) -> None:
        self._checks.pop(project.id, None)
        running = self.jobs.of(project.id, "check")
        if running is not None and running.state == "running":
            self.check_soon(project)  # it looks at what was there before
        elif running is None:
            with contextlib.suppress(Refusal):
                self.check(project)

    def check(self, project: Project) -> JobState:
        """Check the photos of a project now."""
        running = self.jobs.of(project.id, "check")
        return running or self.jobs.add("check", project.id, project.name)

    # -- what is shown ----------------------------------------------------------------------------

    def look(self, project: Project, style: str | None, mix: dict[str, Any],
             **more: Any) -> dict[str, Any]:
        """What a preview shows (`lfportrait.studio.work.resident.Look`)."""
        project.need("field")
        found: dict[str, Any] = {"job": str(project.job), "style": None, "mix": {}, **more}
        pixels = (project.settings().get("options") or {}).get("pixels")
        if pixels:
            found["pixels"] = float(pixels)
        if style is not None:
            def named(one: str) -> str:
                return self.styles.get(one, project).source

            found["style"] = named(style)
            found["mix"], found["styles"] = mix_arguments(mix, style, named)
        return found

    def version_look(self, project: Project, version: Version,
                     mix: dict[str, Any] | None = None) -> dict[str, Any]:
        """What a version shows: its painted field where it is fine, else a preview."""
        if version.fine and mix in (None, version.mix):
            return {"styled": str(version.styled)}
        if version.from_command_line:
            return {"styled": str(version.styled), "mix": mix or {}}
        return self.look(project, version.style, version.mix if mix is None else mix)

    def warm(self, project: Project) -> None:
        """Have a head read before a preview of it is asked for, where nothing else is going on."""
        if not project.has()["field"] or self.previews.busy or any(
                job.heavy and not job.over for job in self.jobs.jobs.values()):
            return

        async def read() -> None:
            with contextlib.suppress(Refusal):
                look = self.look(project, None, {})
                await self.previews.ask("warm", look, "warm", Turn.LATER)

        task = asyncio.get_running_loop().create_task(read())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def mixed_look(self, project: Project, version: Version, mix: dict[str, Any]) -> dict[str, Any]:
        """A version's own painted field in another mix: what fits to its page that is open."""
        if not version.fine:
            return self.look(project, version.style, mix)
        arguments, _ = mix_arguments(mix, version.style or "", lambda one: one)
        return {"styled": str(version.styled), "mix": {"strength": 1.0, **arguments}}

    # -- jobs -------------------------------------------------------------------------------------

    def order(self, job: JobState) -> Order:
        """What a job's process is sent."""
        pictures = self.jobs.pictures(job)
        if job.kind == "networks":
            return Order("networks", pictures, more=dict(job.order))
        project = self.projects.get(str(job.project))
        settings = project.settings()
        choices: dict[str, Any] = {
            "pictures": pictures, "folder": project.folder, "job": project.job,
            "source": project.source, "demo": bool(settings.get("demo")), "name": project.name,
            "options": {**settings.get("options", {}), **job.order.get("options", {})},
            "display": self.displays.of(project).source}
        if job.kind == "check":
            project.need("photos")
            return Order("check", **choices, more={
                "key": check_key(project), "count": len(project.files())})
        if job.kind == "head":
            project.need("photos")
            return Order("head", **choices)
        version = Versions(project).get(str(job.version))
        if job.kind == "export":
            panel = self.displays.get(job.order.get("display") or project.display)
            if job.order.get("fine") and not version.fine and not self.jobs.waits(job):
                raise Refusal("not_ready", "the version was not made fine, so the file was not "
                              "made: let it go on, and the version is made fine first",
                              needs="styled")
            job.order["quality"] = exports.quality_of(version.fine or bool(job.order.get("fine")))
            look = self.version_look(project, version)
            return Order("export", **{**choices, "display": panel.source},
                         more={**job.order, "version": version.id, "look": look})
        job.order["wanted"] = version.wanted()
        return self._fine(project, version, choices)

    def _fine(self, project: Project, version: Version, choices: dict[str, Any]) -> Order:
        project.need("capture", "field")
        if version.from_command_line or version.style is None:
            raise Refusal("exists", "this version was made in full by the command line")
        style = self.styles.get(version.style, project)
        mix, others = mix_arguments(version.mix, version.style,
                                    lambda one: self.styles.get(one, project).source)
        return Order("fine", **choices, style=style.source, style_id=style.id,
                     version=version.folder, mix=mix, more={"styles": others})

    def _making(self, project: Project, version: Version) -> JobState | None:
        """The job that makes a version fine."""
        return next((job for job in self.jobs.jobs.values()
                     if job.kind == "fine" and job.project == project.id
                     and job.version == version.id and not job.over), None)

    def fine(self, project: Project, version: Version) -> JobState:
        """Make a version fine; the job that does."""
        return self._making(project, version) or self.jobs.add(
            "fine", project.id, project.name, version=version.id,
            order={"wanted": version.wanted(), "title": version.name})

    def export(self, project: Project, version: Version, choices: dict[str, Any]) -> JobState:
        """Export a version; the job that does.

        With ``fine`` among the choices it waits until the version is made fine; ``target`` is the
        file.
        """
        after = None
        if choices.get("fine") and not version.fine:
            after = self.fine(project, version).id
        return self.jobs.add("export", project.id, project.name, version=version.id, after=after,
                             export=choices["kind"],
                             order={**choices, "title": Path(choices["target"]).name})

    def resume(self, job: JobState) -> None:
        """Let a job go on; a file of a fine version waits for that, which is made if need be."""
        if job.kind == "export" and job.state in ("failed", "cancelled") and job.order.get("fine"):
            project = self.projects.get(str(job.project))
            version = Versions(project).get(str(job.version))
            if not version.fine:
                job.after = self.fine(project, version).id
        self.jobs.resume(job)

    def look_at_disk(self) -> None:
        """Say so when the disk is nearly full, once in a while."""
        now, free = time.monotonic(), free_disk_bytes(self.projects.folder)
        if free < _LOW and now - self._warned > _AGAIN:
            self._warned = now
            self.events.tell("disk", {"free_bytes": free})

    def _changed(self, job: JobState) -> None:
        """What depends on a job's state."""
        self.look_at_disk()
        if job.kind in ("export", "fine") and job.state in ("cancelled", "failed"):
            with contextlib.suppress(Refusal, OSError):
                place = Path(job.order["target"]) if job.kind == "export" else Versions(
                    self.projects.get(str(job.project))).get(str(job.version)).folder
                exports.forget_unfinished(place, job.created)
        if job.state == "done" and job.project is not None:
            # At once: a job that waits for this one begins after it.
            with contextlib.suppress(Refusal, UserError, OSError):
                self._finished(self.projects.get(job.project), job)
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:  # the server has not begun
            return
        loop.call_soon(self._follow, job, job.state)

    def _follow(self, job: JobState, state: str) -> None:
        """Tell the pages what a job's ``state`` has changed."""
        if job.project is None:
            if job.kind == "networks" and state == "done":
                self.events.tell("reset")
            return
        try:
            project = self.projects.get(job.project)
            kinds = {"check": ("photos",), "fine": ("versions",), "export": ("exports",),
                     "head": ("photos", "styles")}.get(job.kind, ())
            if state != "running" or job.kind == "head":
                self.tell_project(project, *(kinds if state != "running" else ()))
        except (Refusal, OSError):
            return  # the project was removed

    def _finished(self, project: Project, job: JobState) -> None:
        """Keep what a job has made."""
        if job.kind == "fine":
            version = Versions(project).get(str(job.version))
            version.save(fine=job.order.get("wanted"))
        elif job.kind == "export" and job.result is not None:
            exports.keep(project, job.result)


def export_order(desk: Desk, project: Project, data: dict[str, Any]) -> dict[str, Any]:
    """The choices of an export, checked; the file is not yet named."""
    kind = exports.kind_of(str(data.get("kind")))
    display = data.get("display")
    if display is not None:
        display = desk.displays.get(str(display)).id
    return {"kind": kind.name, "display": display or desk.displays.of(project).id,
            "fine": truth(data, "fine"),
            "placement": exports.checked_placement(data.get("placement")),
            "options": exports.checked_options(kind, data.get("options"))}
