"""The fifth screen: versions, and the viewer."""

from __future__ import annotations

import asyncio
import hashlib
import re
from pathlib import Path
from typing import Any

from starlette.responses import Response

from ...files import read_json
from ..answers import Refusal, text, whole
from ..previews import Turn
from ..projects import Project
from ..versions import Version, Versions, checked_mix, styles_of
from .call import Call, Table, picture, shown_page
from .painting import cameras_of

TABLE = Table()

_PAGES = 24
"""Pages of the viewer that are kept for a project."""
_KEY = re.compile("[0-9a-f]{32}")


def _version(call: Call) -> tuple[Project, Version]:
    project = call.project
    return project, Versions(project).get(call.word("version"))


def _mix(call: Call, project: Project) -> dict[str, Any]:
    """The mix of a request, whose styles there are."""
    mix = checked_mix(call.data.get("mix"))
    for style in styles_of(mix):
        call.desk.styles.get(style, project)
    return mix


@TABLE.add("GET", "/api/projects/{project}/versions")
def versions(call: Call) -> dict[str, Any]:
    """All versions."""
    project = call.project
    return {"versions": [call.desk.version_entry(project, one)
                         for one in Versions(project).all()]}


@TABLE.add("POST", "/api/projects/{project}/versions")
def create(call: Call) -> tuple[int, dict[str, Any]]:
    """A new version."""
    project = call.project
    style = call.desk.styles.get(text(call.data, "style"), project)
    version = Versions(project).create(text(call.data, "name"), style.id, _mix(call, project))
    project.change(version=version.id)
    call.desk.tell_project(project, "versions")
    return 201, call.desk.version_entry(project, version)


@TABLE.add("PATCH", "/api/projects/{project}/versions/{version}")
def change(call: Call) -> dict[str, Any]:
    """Another name, style or mix."""
    project, version = _version(call)
    if version.from_command_line:
        raise Refusal("exists", "this version was made by the command line: copy it to change it")
    found: dict[str, Any] = {}
    if "name" in call.data:
        found["name"] = text(call.data, "name")
    if "style" in call.data:
        found["style"] = call.desk.styles.get(text(call.data, "style"), project).id
    if "mix" in call.data:
        found["mix"] = _mix(call, project)
    version = version.save(**found)
    call.desk.tell_project(project, "versions")
    return call.desk.version_entry(project, version)


@TABLE.add("DELETE", "/api/projects/{project}/versions/{version}")
async def remove(call: Call) -> dict[str, Any]:
    """Remove a version."""
    project, version = _version(call)
    if call.desk.version_entry(project, version)["job"]:
        raise Refusal("busy", "this version is being made fine; cancel that first")
    await asyncio.to_thread(Versions(project).remove, version)
    call.desk.tell_project(project, "versions")
    return {"ok": True}


@TABLE.add("POST", "/api/projects/{project}/versions/{version}/copy")
def copy(call: Call) -> tuple[int, dict[str, Any]]:
    """A copy under another name."""
    project, version = _version(call)
    if version.style is None:
        raise Refusal("exists", "this version was made by the command line, by a painting that is "
                      "not in the gallery: add the painting, then make a version of it")
    fresh = Versions(project).create(text(call.data, "name"), version.style, version.mix)
    call.desk.tell_project(project, "versions")
    return 201, call.desk.version_entry(project, fresh)


@TABLE.add("POST", "/api/projects/{project}/versions/{version}/fine")
async def fine(call: Call) -> tuple[int, dict[str, Any]]:
    """Make a version fine."""
    job = call.desk.fine(*_version(call))
    call.desk.events.tell("versions", {"project": job.project})
    return 201, call.desk.jobs.entry(job)


async def _picture(call: Call, look: dict[str, Any], size: int, keep: Path | None = None) -> bytes:
    facts = {"look": look, "cameras": cameras_of(call.data), "size": size}
    if keep is not None:
        facts["keep"] = str(keep)
    found = await call.ask("preview", facts, text(call.data, "slot", ""),
                           Turn.LATER if keep is not None else None)
    data: bytes = found["picture"]
    return data


@TABLE.add("GET", "/api/projects/{project}/versions/{version}/thumbnail")
async def thumbnail(call: Call) -> Any:
    """A version's picture, made once."""
    project, version = _version(call)
    look = call.desk.version_look(project, version)
    state = hashlib.sha256(repr((look, version.fine, version.styled.stat().st_mtime_ns
                                 if version.fine else 0)).encode()).hexdigest()[:12]
    path = project.own / "versions" / f"{version.id}-{state}.jpg"
    if not path.is_file():
        await _picture(call, look, 320, path)
        call.desk.tell_project(project)  # it is the sitter's picture now
    return picture(call, path)


@TABLE.add("POST", "/api/projects/{project}/versions/{version}/picture")
async def version_picture(call: Call) -> Response:
    """A version from some cameras, in its own or another mix."""
    project, version = _version(call)
    mix = _mix(call, project) if "mix" in call.data else None
    data = await _picture(call, call.desk.version_look(project, version, mix),
                          whole(call.data, "size", 64, 2048, 480))
    return Response(data, media_type="image/jpeg")


@TABLE.add("POST", "/api/projects/{project}/viewer")
async def viewer(call: Call) -> dict[str, Any]:
    """The page of a version or a mix, for an iframe."""
    project, data = call.project, call.data
    if data.get("version") is not None:
        version = Versions(project).get(text(data, "version"))
        mix = _mix(call, project) if "mix" in data else None
        look, is_fine = call.desk.version_look(project, version, mix), version.fine
    else:
        style = data.get("style")
        if style is not None:
            style = call.desk.styles.get(text(data, "style"), project).id
        look, is_fine = call.desk.look(project, style, _mix(call, project)), False
    folder = project.own / "pages"
    folder.mkdir(parents=True, exist_ok=True)
    found = await call.ask("viewer", {
        "look": look, "folder": str(folder), "title": project.name})
    key = found["key"]
    await asyncio.to_thread(_forget, folder, key)
    about = await asyncio.to_thread(read_json, folder / f"{key}.json")
    return {"page": f"/view/{project.id}/{key}.html", "fine": is_fine, **about}


@TABLE.add("POST", "/api/projects/{project}/colors")
async def colors(call: Call) -> dict[str, Any]:
    """The colors of mixes, for a page of the viewer that is open."""
    project = call.project
    version = Versions(project).get(text(call.data, "version"))
    mixes = call.data.get("mixes")
    if not isinstance(mixes, list) or not 1 <= len(mixes) <= 2:
        raise Refusal("bad_request", "mixes must be one or two mixes", field="mixes")
    looks = [call.desk.mixed_look(project, version, checked_mix(mix)) for mix in mixes]
    page = _page(project, text(call.data, "page").rpartition("/")[2])
    found: dict[str, Any] = await call.ask(
        "colors", {"page": str(page), "looks": looks}, text(call.data, "slot", ""))
    return found


def _page(project: Project, name: str) -> Path:
    """The file of a page of the viewer."""
    key, _, ending = name.rpartition(".")
    path = project.own / "pages" / f"{key}.html"
    if ending != "html" or not _KEY.fullmatch(key) or not path.is_file():
        raise Refusal("not_found", "there is no such page any more; open the portrait again")
    return path


def _forget(folder: Path, key: str) -> None:
    """Keep the newest pages only."""
    pages = sorted(folder.glob("*.html"), key=lambda path: path.stat().st_mtime)
    for path in pages[:-_PAGES]:
        if path.stem != key:
            path.unlink(missing_ok=True)
            path.with_suffix(".json").unlink(missing_ok=True)


@TABLE.add("GET", "/view/{project}/{page}")
def view(call: Call) -> Response:
    """The page itself."""
    return shown_page(_page(call.project, call.word("page")))
