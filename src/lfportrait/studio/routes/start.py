"""The screens of the beginning and of making: state, projects, networks, photos, jobs."""

import asyncio
import time
from pathlib import Path
from typing import Any

from starlette.responses import StreamingResponse

from ... import models
from ...measure import free_disk_bytes, usable_cores
from ...runner import CAN_PAUSE
from ...version import __version__
from ..answers import Refusal, choice, text, truth, whole
from ..exports import checked_placement
from ..jobs import Order
from ..photos import find_photo, leave_out, photo_entry, photo_picture, remove_photo
from ..versions import Versions, make_command
from .call import Call, Table, picture, query_number, shown_page

TABLE = Table()


@TABLE.add("GET", "/api/state")
def state(call: Call) -> dict[str, Any]:
    desk = call.desk
    number = desk.events.number  # what happens from here on comes as events
    return {"version": __version__, "folder": str(desk.projects.folder),
            "free_bytes": free_disk_bytes(desk.projects.folder), "cores": usable_cores(),
            "projects": [desk.project_entry(one) for one in desk.projects.all()],
            "jobs": desk.jobs.entries(), "networks": _networks(), "event": number,
            "features": {"colors": True, "pause": CAN_PAUSE}}


def _networks() -> list[dict[str, Any]]:
    needed = {*models.GROUPS["portrait"]}
    return [{"name": name, "for": models.PURPOSES.get(name, ""),
             "size_bytes": min(entry.size for entry in entries),
             "present": models.available(name), "needed": name in needed,
             "licence": entries[0].licence}
            for name, entries in models.REGISTRY.items()]


@TABLE.add("GET", "/api/doctor")
def doctor(call: Call) -> dict[str, Any]:
    from ...health import examine

    grades = {"good": "good", "optional": "fair", "bad": "bad"}
    return {"checks": [{"name": fact.name, "group": fact.group, "grade": grades[fact.state],
                        "text": fact.text, "advice": fact.remedy}
                       for fact in examine(call.desk.projects.folder)]}


@TABLE.add("POST", "/api/networks")
async def networks(call: Call) -> tuple[int, dict[str, Any]]:
    names, known = call.data.get("names"), models.REGISTRY
    if not isinstance(names, list) or not names or not all(one in known for one in names):
        raise Refusal("bad_request", "names must be networks of the list", field="names")
    jobs = call.desk.jobs
    return 202, jobs.entry(jobs.add("networks", None, "", order={"names": names}))


@TABLE.add("POST", "/api/shutdown")
async def shutdown(call: Call) -> tuple[int, dict[str, Any]]:
    asyncio.get_running_loop().call_later(0.2, call.desk.stop)
    return 202, {"ok": True}


@TABLE.add("GET", "/api/projects")
def projects(call: Call) -> dict[str, Any]:
    return {"projects": [call.desk.project_entry(one) for one in call.desk.projects.all()]}


@TABLE.add("POST", "/api/projects")
def create(call: Call) -> tuple[int, dict[str, Any]]:
    project = call.desk.projects.create(text(call.data, "name"), truth(call.data, "demo"))
    call.desk.tell_project(project)
    return 201, call.desk.project_entry(project)


@TABLE.add("GET", "/api/projects/{project}")
def show(call: Call) -> dict[str, Any]:
    return call.desk.project_entry(call.project)


@TABLE.add("PATCH", "/api/projects/{project}")
def change(call: Call) -> dict[str, Any]:
    """Keep choices."""
    project, data = call.project, call.data
    found: dict[str, Any] = {}
    if "name" in data:
        found["name"] = text(data, "name")
    if "display" in data:
        found["display"] = call.desk.displays.get(text(data, "display")).id
    if "style" in data:
        style = None if data["style"] is None else call.desk.styles.get(
            text(data, "style"), project)
        # A job that makes the head looks here for what it may show.
        found |= {"style": style and style.id, "painting": style and style.source}
    if "version" in data:
        found["version"] = None if data["version"] is None else Versions(project).get(
            text(data, "version")).id
    if "placement" in data:
        checked_placement(data["placement"])
        found["placement"] = data["placement"]
    if "options" in data:
        found["options"] = _options(data["options"])
    project.change(**found)
    call.desk.tell_project(project)
    return call.desk.project_entry(project)


def _options(data: Any) -> dict[str, Any]:
    """Options of jobs: they are checked in full by the job that reads them."""
    known = ("quick", "parameters", "size", "views", "pixels")
    if not isinstance(data, dict) or not set(data) <= {*known}:
        raise Refusal("bad_request", f"options are {', '.join(known)}", field="options")
    parameters = data.get("parameters", {})
    if not isinstance(parameters, dict) or not all(
            isinstance(value, (bool, int, float, str, list)) for value in parameters.values()):
        raise Refusal("bad_request", "parameters must be an object of values", field="parameters")
    return data


@TABLE.add("DELETE", "/api/projects/{project}")
async def remove(call: Call) -> dict[str, Any]:
    project = call.project
    if call.data.get("confirm") != project.name:
        raise Refusal("bad_request", "confirm must be the project's name", field="confirm")
    for job in [one for one in call.desk.jobs.jobs.values() if one.project == project.id]:
        if not job.over:
            raise Refusal("busy", "a job works on this project; cancel it first")
        call.desk.jobs.remove(job)
    trash = await asyncio.to_thread(call.desk.projects.remove, project)
    call.desk.events.tell("project-removed", {"project": project.id})
    return {"ok": True, "trash": trash}


@TABLE.add("POST", "/api/trash")
async def restore(call: Call) -> dict[str, Any]:
    project = await asyncio.to_thread(call.desk.projects.restore, text(call.data, "name"))
    call.desk.tell_project(project)
    return call.desk.project_entry(project)


@TABLE.add("GET", "/api/projects/{project}/thumbnail")
def thumbnail(call: Call) -> Any:
    path = call.desk.thumbnail(call.project)
    if path is None:
        raise Refusal("not_found", "there is no picture yet")
    return picture(call, path)


@TABLE.add("GET", "/api/projects/{project}/command")
def command(call: Call) -> dict[str, Any]:
    """The same on the command line."""
    project = call.project
    style = project.settings().get("style")
    source = None
    if style:
        try:
            source = call.desk.styles.get(str(style), project).source
        except Refusal:
            source = None
    settings = project.settings()
    heads = [job for job in call.desk.jobs.jobs.values()
             if job.kind == "head" and job.project == project.id]
    order = Order("head", Path(), demo=bool(settings.get("demo")), options={
        **settings.get("options", {}), **(heads[-1].order.get("options", {}) if heads else {})})
    return {"make": make_command(project, source, call.desk.displays.of(project).source,
                                 order.words()),
            "folder": str(project.folder), "at": round(time.time(), 3)}


@TABLE.add("POST", "/api/projects/{project}/uploads")
def announce(call: Call) -> dict[str, Any]:
    return {"files": call.desk.uploads.announce(call.project, call.data.get("files"))}


@TABLE.add("PUT", "/api/projects/{project}/uploads/{upload}")
async def upload(call: Call) -> tuple[int, dict[str, Any]]:
    project = call.project
    length = int(call.request.headers.get("content-length", "0"))
    path = await call.desk.uploads.receive(project, call.word("upload"),
                                           query_number(call, "offset", 0), length,
                                           call.request.stream())
    call.desk.check_soon(project)
    call.desk.look_at_disk()
    call.desk.tell_project(project, "photos")
    return 201, {"photo": await asyncio.to_thread(photo_entry, project, path)}


@TABLE.add("GET", "/api/projects/{project}/photos")
def contact_sheet(call: Call) -> dict[str, Any]:
    return call.desk.photos(call.project)


@TABLE.add("POST", "/api/projects/{project}/check")
async def check(call: Call) -> tuple[int, dict[str, Any]]:
    return 202, call.desk.jobs.entry(call.desk.check(call.project))


@TABLE.add("PATCH", "/api/projects/{project}/photos/{photo}")
async def change_photo(call: Call) -> dict[str, Any]:
    """Leave a photo out, or take it in again."""
    project = call.project
    path = await asyncio.to_thread(leave_out, project, find_photo(project, call.word("photo")),
                                   truth(call.data, "left_out"))
    call.desk.check_soon(project)
    call.desk.tell_project(project, "photos")
    return photo_entry(project, path)


@TABLE.add("DELETE", "/api/projects/{project}/photos/{photo}")
async def drop_photo(call: Call) -> dict[str, Any]:
    project = call.project
    await asyncio.to_thread(remove_photo, project, find_photo(project, call.word("photo")))
    call.desk.check_soon(project)
    call.desk.tell_project(project, "photos")
    return {"ok": True}


@TABLE.add("GET", "/api/projects/{project}/photos/{photo}/picture")
def photo(call: Call) -> Any:
    project = call.project
    return picture(call, photo_picture(project, find_photo(project, call.word("photo")),
                                       query_number(call, "size", 240)))


@TABLE.add("GET", "/api/jobs")
async def jobs(call: Call) -> dict[str, Any]:
    return {"jobs": call.desk.jobs.entries()}


@TABLE.add("POST", "/api/jobs")
async def add(call: Call) -> tuple[int, dict[str, Any]]:
    """A new job: the sitter's head, or a version in full."""
    kind = choice(call.data, "kind", ("head", "fine"))
    project = call.desk.projects.get(text(call.data, "project"))
    given = call.data.get("options")
    options = _options({} if given is None else given)
    if kind == "fine":
        job = call.desk.fine(project, Versions(project).get(text(call.data, "version")))
    else:
        making = call.desk.jobs.of(project.id, "head")
        if making is not None:
            raise Refusal("busy", "the head of this sitter is being made already", job=making.id)
        job = call.desk.jobs.add("head", project.id, project.name, order={"options": options})
    return 201, call.desk.jobs.entry(job)


@TABLE.add("GET", "/api/jobs/{job}")
async def job(call: Call) -> dict[str, Any]:
    return call.desk.jobs.entry(call.desk.jobs.get(call.word("job")))


@TABLE.add("DELETE", "/api/jobs/{job}")
async def forget(call: Call) -> dict[str, Any]:
    call.desk.jobs.remove(call.desk.jobs.get(call.word("job")))
    return {"ok": True}


@TABLE.add("POST", "/api/jobs/{job}/{what}")
async def act(call: Call) -> dict[str, Any]:
    """Pause a job, let it go on, cancel it, or move it in the queue."""
    jobs = call.desk.jobs
    found, what = jobs.get(call.word("job")), call.word("what")
    if what == "pause":
        jobs.pause(found)
    elif what == "resume":
        call.desk.resume(found)
    elif what == "cancel":
        await jobs.cancel(found)
    elif what == "move":
        jobs.move(found, whole(call.data, "place", 0, 1000))
        return {"jobs": jobs.entries()}
    else:
        raise Refusal("not_found", "a job can be paused, resumed, cancelled or moved")
    return jobs.entry(found)


def _of_stage(call: Call, ending: str) -> Path:
    """The file of a stage of a job."""
    found, name = call.desk.jobs.get(call.word("job")), call.word("stage")
    if all(one.name != name for one in found.stages):
        raise Refusal("not_found", "there is no such stage")
    return call.desk.jobs.pictures(found) / f"{name}.{ending}"


@TABLE.add("GET", "/api/jobs/{job}/stages/{stage}/picture")
async def stage_picture(call: Call) -> Any:
    path = _of_stage(call, "jpg")
    if not path.is_file():
        raise Refusal("not_found", "there is no picture yet")
    return picture(call, path)


@TABLE.add("GET", "/api/jobs/{job}/stages/{stage}/page")
def stage_page(call: Call) -> Any:
    """The page that shows a head as far as a stage has made it."""
    return shown_page(_of_stage(call, "html"))


@TABLE.add("GET", "/api/events")
async def events(call: Call) -> Any:
    word = call.request.headers.get("last-event-id") or call.request.query_params.get("after")
    number = int(word) if word and word.isascii() and word.isdigit() else None
    return StreamingResponse(call.desk.events.stream(number), media_type="text/event-stream",
                             headers={"x-accel-buffering": "no"})
