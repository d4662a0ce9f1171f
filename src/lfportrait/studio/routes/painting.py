"""The screens of painting and of the portrait: gallery, landmarks, regions, previews, versions."""

import asyncio
import re
from pathlib import Path
from typing import Any

from starlette.responses import Response

from ...files import read_json, write_bytes
from ...labels import BY_HAND
from .. import styles
from ..answers import Refusal, number, numbers, points, stamp_of, text, whole
from ..previews import Turn
from ..projects import Project, record_in
from ..styles import LARGEST, Style
from ..versions import Version, Versions, checked_mix, styles_of
from .call import Call, Table, picture, query_number, shown_page

TABLE = Table()

_SIZES = (320, 0)
_FRONT = [(0.0, 0.0, 1.0)]


def _style(call: Call) -> tuple[Style, Project | None]:
    project = call.query_project
    return call.desk.styles.get(call.word("style"), project), project


def _tell(call: Call, project: Project | None) -> None:
    call.desk.events.tell("styles", {"project": None if project is None else project.id})


@TABLE.add("GET", "/api/styles")
async def gallery(call: Call) -> dict[str, Any]:
    """The gallery; whoever looks at it will soon want a preview."""
    project = call.query_project
    if project is not None:
        call.desk.warm(project)
    return {"styles": await asyncio.to_thread(lambda: [
        call.desk.styles.entry(one, project) for one in call.desk.styles.all(project)])}


@TABLE.add("PUT", "/api/styles")
async def add(call: Call) -> tuple[int, dict[str, Any]]:
    project = call.query_project
    data = await _body(call)
    style, fresh = await asyncio.to_thread(call.desk.styles.add,
                                           call.request.query_params.get("name", ""), data, project)
    _tell(call, project)
    return (201 if fresh else 200), call.desk.styles.entry(style, project)


async def _body(call: Call) -> bytes:
    """The bytes of an upload that is held in memory."""
    if int(call.request.headers.get("content-length", "0")) > LARGEST:
        raise Refusal("too_large", f"a picture may have {LARGEST >> 20} MB")
    data = bytearray()
    async for chunk in call.request.stream():
        data += chunk
        if len(data) > LARGEST:
            raise Refusal("too_large", f"a picture may have {LARGEST >> 20} MB")
    return bytes(data)


@TABLE.add("PATCH", "/api/styles/{style}")
def rename(call: Call) -> dict[str, Any]:
    style, project = _style(call)
    style = call.desk.styles.rename(style, text(call.data, "name"), project)
    _tell(call, project)
    return call.desk.styles.entry(style, project)


@TABLE.add("DELETE", "/api/styles/{style}")
def remove(call: Call) -> dict[str, Any]:
    style, project = _style(call)
    call.desk.styles.remove(style)
    _tell(call, project)
    return {"ok": True}


@TABLE.add("POST", "/api/styles/{style}/copy")
async def copy(call: Call) -> tuple[int, dict[str, Any]]:
    style, project = _style(call)
    target = call.desk.styles.folder(project) / f"{style.name}.png"
    if target.exists():
        raise Refusal("exists", f"there is a painting {style.name!r} already")
    await call.desk.previews.ask("copy_style", {"style": style.source, "file": str(target)})
    _tell(call, project)
    word = "own" if project is not None else "mine"
    fresh = next(one for one in call.desk.styles.all(project)
                 if one.path == target and one.id.startswith(word))
    return 201, call.desk.styles.entry(fresh, project)


@TABLE.add("GET", "/api/styles/{style}/picture")
async def style_picture(call: Call) -> Any:
    """A painting's picture, written again by us."""
    style, project = _style(call)
    size = query_number(call, "size", 320)
    if size not in _SIZES:
        raise Refusal("bad_request", f"size must be one of {_SIZES}", field="size")
    stamp = f"{style.path.stat().st_mtime_ns:x}" if style.path is not None else "0"
    name = f"{style.id}-{stamp}-{size}.{'jpg' if size else 'png'}"
    # Built-in ones are the same for all sitters.
    path = call.desk.styles.own(project if style.path is not None else None) / name
    if not path.is_file() and style.path is not None:
        # A file is only read: it is there while the previews' process has much to do.
        await asyncio.to_thread(styles.write_picture, style.path, size, path)
    elif not path.is_file():
        await call.ask("style_picture", {"style": style.source, "size": size, "file": str(path)},
                       turn=Turn.LATER if size else Turn.NEXT)
    return picture(call, path)


@TABLE.add("GET", "/api/styles/{style}/check")
async def check(call: Call) -> Any:
    style, _ = _style(call)
    return await call.ask("check_style", {"style": style.source})


async def _found(call: Call, style: Style, project: Project | None) -> dict[str, Any]:
    """The faces that are found in a painting."""
    path = call.desk.styles.faces_file(style, project)
    kept = record_in(path)
    if kept is not None:
        return kept
    found: dict[str, Any] = await call.desk.previews.ask(
        "faces", {"style": style.source, "file": str(path)})
    return found


@TABLE.add("GET", "/api/styles/{style}/faces")
async def faces(call: Call) -> dict[str, Any]:
    """All faces of a painting."""
    style, project = _style(call)
    data = await _found(call, style, project)
    used = _points(style, data)
    entries = []
    for count, face in enumerate(data["faces"], 1):
        x, y = ([one[axis] for one in face] for axis in (0, 1))
        entries.append({"number": count, "landmarks": face,
                        "box": [min(x), min(y), max(x) - min(x), max(y) - min(y)]})
    return {"faces": entries, "width": data["width"], "height": data["height"],
            "chosen": _nearest(used, data["faces"])}


def _nearest(used: list[list[float]] | None, found: list[list[list[float]]]) -> int | None:
    """Number of the face that some landmarks are those of."""
    if used is None or not found:
        return None

    def middle(face: list[list[float]]) -> tuple[float, float]:
        return sum(one[0] for one in face) / len(face), sum(one[1] for one in face) / len(face)

    x, y = middle(used)
    apart = [(middle(face)[0] - x) ** 2 + (middle(face)[1] - y) ** 2 for face in found]
    return apart.index(min(apart)) + 1


def _points(style: Style, data: dict[str, Any]) -> list[list[float]] | None:
    """The landmarks that are used: those beside the painting, else the largest face's."""
    if style.path is not None and style.beside("landmarks.txt").is_file():
        lines = style.beside("landmarks.txt").read_text("utf-8").replace(",", " ").splitlines()
        rows = [[float(word) for word in line.split()] for line in lines if line.strip()]
        if len(rows) == 68 and all(len(row) == 2 for row in rows):
            return rows
    return data["faces"][0] if data["faces"] else None


@TABLE.add("GET", "/api/styles/{style}/landmarks")
async def landmarks(call: Call) -> dict[str, Any]:
    style, project = _style(call)
    data = await _found(call, style, project)
    used = _points(style, data)
    chosen = _nearest(used, data["faces"])
    return {"points": used, "found": data["faces"][chosen - 1] if chosen else None,
            "edited": style.path is not None and style.beside("landmarks.txt").is_file(),
            "width": data["width"], "height": data["height"], "lines": styles.LINES,
            "groups": styles.GROUPS, "mirror": styles.MIRROR}


@TABLE.add("POST", "/api/styles/{style}/face")
async def choose(call: Call) -> dict[str, Any]:
    """Choose a face by its number, or by a place on it."""
    style, project = _style(call)
    style.beside("landmarks.txt")
    facts: dict[str, Any] = {"style": style.source}
    if "at" in call.data:
        facts["at"] = numbers(call.data, "at", 2)
    else:
        facts["face"] = whole(call.data, "face", 1, 100)
    await call.desk.previews.ask("choose", facts)
    _tell(call, project)
    return await landmarks(call)


@TABLE.add("PUT", "/api/styles/{style}/landmarks")
async def place(call: Call) -> dict[str, Any]:
    """Write the landmarks beside the painting, in the file that the commands read."""
    style, project = _style(call)
    found = points(call.data, "points")
    lines = "".join(f"{x:.2f} {y:.2f}\n" for x, y in found)
    write_bytes(style.beside("landmarks.txt"), lines.encode())
    _tell(call, project)
    return await landmarks(call)


@TABLE.add("DELETE", "/api/styles/{style}/landmarks")
async def reset(call: Call) -> dict[str, Any]:
    """Back to the landmarks that are found."""
    style, project = _style(call)
    style.beside("landmarks.txt").unlink(missing_ok=True)
    _tell(call, project)
    return await landmarks(call)


@TABLE.add("GET", "/api/styles/{style}/regions")
async def regions(call: Call) -> dict[str, Any]:
    """The regions of a painting: what is found, and what was painted over."""
    style, project = _style(call)
    data = await _found(call, style, project)
    painted = style.path is not None and style.beside("regions.png").is_file()
    query = f"project={project.id}&" if project is not None else ""
    address = f"/api/styles/{style.id}/regions/picture?{query}v={style.stamp()}&which="
    return {"width": data["width"], "height": data["height"], "labels": list(BY_HAND),
            "painted": painted, "found": f"{address}found",
            "picture": f"{address}painted" if painted else None}


@TABLE.add("PUT", "/api/styles/{style}/regions")
async def paint_regions(call: Call) -> dict[str, Any]:
    style, project = _style(call)
    style.beside("regions.png")
    data = await _found(call, style, project)
    await asyncio.to_thread(styles.write_regions, style, await _body(call),
                            (data["width"], data["height"]))
    _tell(call, project)
    return await regions(call)


@TABLE.add("DELETE", "/api/styles/{style}/regions")
async def forget_regions(call: Call) -> dict[str, Any]:
    """Leave all regions to the detectors."""
    style, project = _style(call)
    style.beside("regions.png").unlink(missing_ok=True)
    _tell(call, project)
    return await regions(call)


@TABLE.add("GET", "/api/styles/{style}/regions/picture")
async def regions_picture(call: Call) -> Any:
    style, project = _style(call)
    if call.request.query_params.get("which") == "painted":
        path = style.beside("regions.png")
        if not path.is_file():
            raise Refusal("not_found", "nothing was painted over")
        return picture(call, path)
    path = call.desk.styles.own(project) / f"{style.id}-{style.stamp()}.regions.png"
    if not path.is_file():
        await call.ask("regions", {"style": style.source, "file": str(path)})
    return picture(call, path)


def cameras_of(data: dict[str, Any]) -> list[tuple[float, float, float]]:
    """The cameras of a request, the front by default."""
    cameras = data.get("cameras")
    if cameras is None:
        return _FRONT
    if not isinstance(cameras, list) or not 1 <= len(cameras) <= 9 or not all(
            isinstance(one, dict) for one in cameras):
        raise Refusal("bad_request", "cameras must be a list of 1 to 9", field="cameras")
    return [(number(one, "yaw", -360, 360, 0.0), number(one, "pitch", -89, 89, 0.0),
             number(one, "zoom", 0.2, 8, 1.0)) for one in cameras]


@TABLE.add("POST", "/api/projects/{project}/preview")
async def preview(call: Call) -> Any:
    """The sitter in a style."""
    project, data = call.project, call.data
    style = data.get("style")
    if style is not None:
        style = call.desk.styles.get(text(data, "style"), project)
    mix = checked_mix(data.get("mix"))
    cameras = cameras_of(data)
    more: dict[str, Any] = {}
    if data.get("landmarks") is not None:
        more["landmarks"] = points(data, "landmarks")
    look = call.desk.look(project, None if style is None else style.id, mix, **more)
    facts = {"look": look, "cameras": cameras, "size": whole(data, "size", 64, 2048, 480)}
    plain = style is not None and not mix and "landmarks" not in more and cameras == _FRONT
    keep = styles.preview_file(project, style) if plain and style is not None else None
    if keep is not None:
        facts["keep"] = str(keep)
    slot = text(data, "slot", "")
    found = await call.ask("preview", facts, slot,
                           Turn.LATER if keep is not None and not slot else None)
    if keep is not None:
        _tell(call, project)
    return Response(found["picture"], media_type="image/jpeg", headers={
        "x-lfportrait-seconds": f"{found['seconds']:.3f}", "x-lfportrait-preview": found["key"]})


@TABLE.add("GET", "/api/projects/{project}/previews/{style}")
def kept_preview(call: Call) -> Any:
    project = call.project
    path = styles.preview_file(project, call.desk.styles.get(call.word("style"), project))
    if not path.is_file():
        raise Refusal("not_found", "there is no preview yet")
    return picture(call, path)


_PAGES = 24  # Pages of the viewer that are kept for a project.
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
    project = call.project
    return {"versions": [call.desk.version_entry(project, one) for one in Versions(project).all()]}


@TABLE.add("POST", "/api/projects/{project}/versions")
def create(call: Call) -> tuple[int, dict[str, Any]]:
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
async def remove_version(call: Call) -> dict[str, Any]:
    project, version = _version(call)
    if call.desk.version_entry(project, version)["job"]:
        raise Refusal("busy", "this version is being made fine; cancel that first")
    await asyncio.to_thread(Versions(project).remove, version)
    call.desk.tell_project(project, "versions")
    return {"ok": True}


@TABLE.add("POST", "/api/projects/{project}/versions/{version}/copy")
def copy_version(call: Call) -> tuple[int, dict[str, Any]]:
    project, version = _version(call)
    if version.style is None:
        raise Refusal("exists", "this version was made by the command line, by a painting that is "
                      "not in the gallery: add the painting, then make a version of it")
    fresh = Versions(project).create(text(call.data, "name"), version.style, version.mix)
    call.desk.tell_project(project, "versions")
    return 201, call.desk.version_entry(project, fresh)


@TABLE.add("POST", "/api/projects/{project}/versions/{version}/fine")
async def fine(call: Call) -> tuple[int, dict[str, Any]]:
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
    state = stamp_of((look, version.fine, version.styled.stat().st_mtime_ns
                      if version.fine else 0), 12)
    path = project.own / "versions" / f"{version.id}-{state}.jpg"
    if not path.is_file():
        await _picture(call, look, 320, path)
        call.desk.tell_project(project)  # it is the sitter's picture now
    return picture(call, path)


@TABLE.add("POST", "/api/projects/{project}/versions/{version}/picture")
async def version_picture(call: Call) -> Response:
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
    found = await call.ask("viewer", {"look": look, "folder": str(folder), "title": project.name})
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
    return shown_page(_page(call.project, call.word("page")))
