"""The sixth screen: panels, the pattern wizard, depth, the eye, exports, batch and study."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from starlette.responses import Response

from ...lightfield import Display
from .. import exports
from ..answers import Refusal, choice, number, numbers, stamp_of, text, whole
from ..batches import batch_file, study_command
from ..desk import export_order
from ..displays import KINDS, Panel, corrected, file_of, wizard_steps
from ..projects import Project
from ..versions import Versions
from .call import Call, Table, attachment, picture

TABLE = Table()


def _panel(call: Call) -> Panel:
    return call.desk.displays.get(call.word("display"))


@TABLE.add("GET", "/api/displays")
def displays(call: Call) -> dict[str, Any]:
    return {"displays": [panel.entry() for panel in call.desk.displays.all()], "bridge": None}


@TABLE.add("GET", "/api/displays/bridge")
async def bridge(call: Call) -> Any:
    found = await call.ask("bridge", {})
    shown = []
    for entry in found["displays"]:
        panel = Panel(f"bridge-{entry['index']}", "bridge", Display(**entry["display"]))
        shown.append({**panel.entry(), "index": entry["index"], "device": entry["name"]})
    return {**found, "displays": shown}


@TABLE.add("POST", "/api/displays")
async def add(call: Call) -> tuple[int, dict[str, Any]]:
    """A panel from a file's text, from Bridge, or a copy of another one."""
    data, desk = call.data, call.desk
    name = text(data, "name", "")
    if "text" in data:
        if not isinstance(data["text"], str):
            raise Refusal("bad_request", "text must be a file's contents", field="text")
        panel = desk.displays.read(name, data["text"])
    elif "bridge" in data:
        found = await call.ask("bridge", {})
        index = whole(data, "bridge", 0, 64)
        entry = next((one for one in found["displays"] if one["index"] == index), None)
        if entry is None:
            raise Refusal("not_found", found["message"] or "Bridge reports no such display")
        panel = desk.displays.add(name or entry["name"], Display(**entry["display"]))
    else:
        source = desk.displays.get(text(data, "copy"))
        panel = desk.displays.copy(source, name or f"{source.display.name} copy")
    return 201, panel.entry()


@TABLE.add("PATCH", "/api/displays/{display}")
def change(call: Call) -> dict[str, Any]:
    """Other numbers."""
    return call.desk.displays.change(_panel(call), call.data).entry()


@TABLE.add("DELETE", "/api/displays/{display}")
def remove(call: Call) -> dict[str, Any]:
    call.desk.displays.remove(_panel(call))
    return {"ok": True}


@TABLE.add("GET", "/api/displays/{display}/file")
def file(call: Call) -> Response:
    panel = _panel(call)
    name = f"{panel.display.name}.toml".encode("ascii", "ignore").decode().replace('"', "")
    return Response(panel.display.to_toml(), media_type="application/octet-stream", headers={
        "content-disposition": f'attachment; filename="{name}"'})


def _pattern_address(panel: Panel, kind: str) -> str:
    return f"/api/displays/{panel.id}/pattern?kind={kind}&v={stamp_of(panel.display)}"


@TABLE.add("GET", "/api/displays/{display}/pattern")
async def pattern(call: Call) -> Any:
    panel = _panel(call)
    kind = choice(dict(call.request.query_params), "kind", KINDS, "views")
    path = call.desk.projects.own / "patterns" / f"{kind}-{stamp_of(panel.display)}.png"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        for old in sorted(path.parent.glob("*.png"), key=lambda one: one.stat().st_mtime)[:-7]:
            old.unlink(missing_ok=True)
        await call.ask("pattern", {"display": panel.source, "kind": kind, "file": str(path)})
    return picture(call, path)


@TABLE.add("GET", "/api/displays/{display}/wizard")
def wizard(call: Call) -> dict[str, Any]:
    panel = _panel(call)
    return {"display": panel.entry(), "steps": [
        {**step, "pattern": _pattern_address(panel, step["kind"])} for step in wizard_steps()]}


@TABLE.add("POST", "/api/displays/{display}/wizard")
def answer(call: Call) -> dict[str, Any]:
    panel = _panel(call)
    file_of(panel)
    step = choice(call.data, "step", ("slant", "views", "fringe"))
    given = call.data.get("answer")
    if not isinstance(given, dict):
        raise Refusal("bad_request", "answer must be an object", field="answer")
    tried = call.desk.wizard.get(panel.id, {})
    display, following, said, kept = corrected(panel.display, step, given, tried)
    call.desk.wizard[panel.id] = kept
    if following is None:
        display = replace(display, calibrated=True)
    panel = call.desk.displays.write(panel, display)
    return {"display": panel.entry(), "next": following, "said": said,
            "pattern": _pattern_address(panel, following or step)}


def _shown(call: Call) -> tuple[Project, dict[str, Any]]:
    """A project, and what is shown on which panel and how."""
    project, data, desk = call.project, call.data, call.desk
    panel = desk.displays.get(str(data.get("display") or desk.displays.of(project).id))
    if data.get("version") is not None:
        look = desk.version_look(project, Versions(project).get(text(data, "version")))
    else:
        style = project.settings().get("style")
        known = style is not None and any(one.id == style for one in desk.styles.all(project))
        look = desk.look(project, style if known else None, {})
    return project, {"look": look, "display": panel.source,
                     "placement": exports.checked_placement(data.get("placement"))}


@TABLE.add("POST", "/api/projects/{project}/budget")
async def budget(call: Call) -> Any:
    _, facts = _shown(call)
    return await call.ask("budget", facts)


@TABLE.add("POST", "/api/projects/{project}/eye")
async def eye(call: Call) -> Response:
    _, facts = _shown(call)
    where = numbers({"eye": call.data.get("eye", [0.0, 0.0])}, "eye", 2, 100.0)
    found = await call.ask("eye", {
        **facts, "eye": where, "crosstalk": number(call.data, "crosstalk", 0, 20, 0.0),
        "width": whole(call.data, "width", 64, 4096, 960)}, text(call.data, "slot", ""))
    return Response(found["picture"], media_type="image/jpeg")


@TABLE.add("POST", "/api/projects/{project}/full")
async def full(call: Call) -> dict[str, Any]:
    """The coded picture for the panel's own window."""
    project, facts = _shown(call)
    folder = project.own / "full"
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink(missing_ok=True)
    stamp = stamp_of(facts)
    await call.ask("full", {**facts, "file": str(folder / f"{stamp}.png")})
    return {"picture": f"/api/projects/{project.id}/full/{stamp}"}


@TABLE.add("GET", "/api/projects/{project}/full/{stamp}")
def full_picture(call: Call) -> Any:
    stamp = call.word("stamp")
    for path in (call.project.own / "full").glob("*.png"):
        if path.stem == stamp:
            return picture(call, path)
    raise Refusal("not_found", "there is no such picture any more")


@TABLE.add("GET", "/api/projects/{project}/exports")
def exported(call: Call) -> dict[str, Any]:
    return {"kinds": exports.kinds(), "exports": exports.entries(call.project)}


@TABLE.add("POST", "/api/projects/{project}/exports")
async def export(call: Call) -> tuple[int, dict[str, Any]]:
    project, data = call.project, call.data
    version = Versions(project).get(text(data, "version"))
    choices = export_order(call.desk, project, data)
    ordered = [Path(job.order["target"]).name for job in call.desk.jobs.jobs.values()
               if job.kind == "export" and job.project == project.id and not job.over]
    target = exports.target(project, exports.kind_of(choices["kind"]), text(data, "name", ""),
                            ordered)
    job = call.desk.export(project, version, {**choices, "target": str(target)})
    return 201, call.desk.jobs.entry(job)


@TABLE.add("GET", "/api/projects/{project}/exports/{export}/file")
def export_file(call: Call) -> Response:
    return attachment(exports.find(call.project, call.word("export")))


@TABLE.add("DELETE", "/api/projects/{project}/exports/{export}")
def export_remove(call: Call) -> dict[str, Any]:
    project = call.project
    exports.remove(project, call.word("export"))
    call.desk.events.tell("exports", {"project": project.id})
    return {"ok": True}


@TABLE.add("POST", "/api/projects/{project}/exports/{export}/cast")
async def cast(call: Call) -> Any:
    path = exports.find(call.project, call.word("export"))
    return await call.desk.previews.ask("cast", {
        "file": str(path), "screen": whole(call.data, "screen", -1, 64, -1)})


@TABLE.add("POST", "/api/batch")
def batch(call: Call) -> dict[str, Any]:
    """A jobs file for `lfportrait batch` from a selection."""
    return batch_file(call.desk, call.data)


@TABLE.add("POST", "/api/study")
def study(call: Call) -> dict[str, Any]:
    """What `lfportrait study` takes, from a selection of versions."""
    return study_command(call.desk, call.data)
