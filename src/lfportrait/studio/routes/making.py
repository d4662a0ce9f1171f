"""The second and third screen: photos come in and are judged; jobs, and the events of all."""

from __future__ import annotations

import asyncio
from typing import Any

from starlette.responses import StreamingResponse

from ..answers import Refusal, choice, text, truth, whole
from ..photos import find_photo, leave_out, photo_entry, photo_picture, remove_photo
from ..versions import Versions
from .call import Call, Table, picture, query_number, shown_page
from .start import heavy, options_of

TABLE = Table()


@TABLE.add("POST", "/api/projects/{project}/uploads")
def announce(call: Call) -> dict[str, Any]:
    """Say what is to be done with each file that the page has."""
    return {"files": call.desk.uploads.announce(call.project, call.data.get("files"))}


@TABLE.add("PUT", "/api/projects/{project}/uploads/{upload}")
async def upload(call: Call) -> tuple[int, dict[str, Any]]:
    """Take in a photo."""
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
    """The contact sheet."""
    return call.desk.photos(call.project)


@TABLE.add("POST", "/api/projects/{project}/check")
async def check(call: Call) -> tuple[int, dict[str, Any]]:
    """Check the photos now."""
    return 202, call.desk.jobs.entry(call.desk.check(call.project))


@TABLE.add("PATCH", "/api/projects/{project}/photos/{photo}")
async def change(call: Call) -> dict[str, Any]:
    """Leave a photo out, or take it in again."""
    project = call.project
    path = await asyncio.to_thread(leave_out, project, find_photo(project, call.word("photo")),
                                   truth(call.data, "left_out"))
    call.desk.check_soon(project)
    call.desk.tell_project(project, "photos")
    return photo_entry(project, path)


@TABLE.add("DELETE", "/api/projects/{project}/photos/{photo}")
async def remove(call: Call) -> dict[str, Any]:
    """Remove a photo."""
    project = call.project
    await asyncio.to_thread(remove_photo, project, find_photo(project, call.word("photo")))
    call.desk.check_soon(project)
    call.desk.tell_project(project, "photos")
    return {"ok": True}


@TABLE.add("GET", "/api/projects/{project}/photos/{photo}/picture")
def photo(call: Call) -> Any:
    """A photo, small."""
    project = call.project
    return picture(call, photo_picture(project, find_photo(project, call.word("photo")),
                                       query_number(call, "size", 240)))


@TABLE.add("GET", "/api/jobs")
async def jobs(call: Call) -> dict[str, Any]:
    """All jobs."""
    return {"jobs": call.desk.jobs.entries()}


@TABLE.add("POST", "/api/jobs")
async def add(call: Call) -> tuple[int, dict[str, Any]]:
    """A new job: the sitter's head, or a version in full."""
    kind = choice(call.data, "kind", ("head", "fine"))
    project = call.desk.projects.get(text(call.data, "project"))
    options = options_of(call.data.get("options"))
    if kind == "fine":
        job = call.desk.fine(project, Versions(project).get(text(call.data, "version")))
    else:
        heavy(call, project)
        job = call.desk.jobs.add("head", project.id, project.name, order={"options": options})
    return 201, call.desk.jobs.entry(job)


@TABLE.add("GET", "/api/jobs/{job}")
async def job(call: Call) -> dict[str, Any]:
    """One job."""
    return call.desk.jobs.entry(call.desk.jobs.get(call.word("job")))


@TABLE.add("DELETE", "/api/jobs/{job}")
async def forget(call: Call) -> dict[str, Any]:
    """Take a job that has ended from the list."""
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


@TABLE.add("GET", "/api/jobs/{job}/stages/{stage}/picture")
async def stage_picture(call: Call) -> Any:
    """The picture of a stage."""
    jobs = call.desk.jobs
    found, name = jobs.get(call.word("job")), call.word("stage")
    if all(one.name != name for one in found.stages):
        raise Refusal("not_found", "there is no such stage")
    path = jobs.pictures(found) / f"{name}.jpg"
    if not path.is_file():
        raise Refusal("not_found", "there is no picture yet")
    return picture(call, path)


@TABLE.add("GET", "/api/jobs/{job}/stages/{stage}/page")
def stage_page(call: Call) -> Any:
    """The page that shows a head as far as a stage has made it."""
    jobs = call.desk.jobs
    found, name = jobs.get(call.word("job")), call.word("stage")
    if all(one.name != name for one in found.stages):
        raise Refusal("not_found", "there is no such stage")
    return shown_page(jobs.pictures(found) / f"{name}.html")


@TABLE.add("GET", "/api/events")
async def events(call: Call) -> Any:
    """What happens, as it happens."""
    word = call.request.headers.get("last-event-id") or call.request.query_params.get("after")
    number = int(word) if word and word.isascii() and word.isdigit() else None
    return StreamingResponse(call.desk.events.stream(number), media_type="text/event-stream",
                             headers={"x-accel-buffering": "no"})
