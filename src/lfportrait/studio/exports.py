"""What a portrait can be exported as, and what was exported."""

import contextlib
import re
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..files import read_json, write_json
from ..share import Export, Option, exports
from ..temporary import MARK
from .answers import Refusal, choice, folder_name, id_of, number, text, truth, whole
from .projects import Project

_BOUND = 1e9  # Of numbers that have none.
_PLACEMENT = {"size": (0.05, 4.0), "shift_x": (-4.0, 4.0), "shift_y": (-4.0, 4.0),
              "focus": (-4.0, 4.0), "depth_scale": (0.01, 4.0), "turn": (-180.0, 180.0),
              "ground_depth": (0.0, 20.0), "background": (0.0, 1.0), "shadow": (0.0, 1.0),
              "ground_blur": (0.0, 10.0)}


def kinds() -> list[dict[str, Any]]:
    """All kinds that the page shows."""
    return [one.entry() for one in exports().values() if one.group]


def kind_of(name: Any) -> Export:
    """A kind by its name."""
    known = exports()
    if name not in known:
        raise Refusal("bad_request", f"kind must be one of {', '.join(known)}", field="kind")
    return known[name]


def checked_placement(data: Any) -> dict[str, Any]:
    """Arguments of `lfportrait.lightfield.EncodeConfig`; by default as `make` places a head."""
    if data is None:
        data = {}
    known = {*_PLACEMENT, "compose", "ground", "blend"}
    if not isinstance(data, dict) or not set(data) <= known:
        raise Refusal("bad_request", f"a placement has {', '.join(sorted(known))}",
                      field="placement")
    found: dict[str, Any] = {name: number(data, name, *ends)
                             for name, ends in _PLACEMENT.items() if name in data}
    found["compose"] = truth(data, "compose", True)
    if "ground" in data:
        found["ground"] = choice(data, "ground", ("painted", "black", "white"))
    if "blend" in data:
        found["blend"] = choice(data, "blend", ("nearest", "continuous", "filtered"))
    return found


def checked_options(kind: Export, data: Any) -> dict[str, Any]:
    """The options of an export, with their defaults."""
    data = {} if data is None else data
    names = [one.name for one in kind.options]
    if not isinstance(data, dict) or not set(data) <= {*names}:
        raise Refusal("bad_request", f"{kind.name} takes {', '.join(names) or 'no options'}",
                      field="options")
    found = {one.name: _checked(one, data) for one in kind.options}
    kind.chosen(found)
    return found


def _checked(option: Option, data: dict[str, Any]) -> Any:
    name, default = option.name, option.default
    if option.choices:
        return choice(data, name, option.choices, str(default))
    if isinstance(default, bool):
        return truth(data, name, default)
    if isinstance(default, str):
        return text(data, name, default)
    low = -_BOUND if option.min is None else option.min
    high = _BOUND if option.max is None else option.max
    if isinstance(default, int):
        return whole(data, name, round(low), round(high), default)
    return number(data, name, low, high, default)


def quality_of(fine: bool) -> str:
    """What is exported: ``"fine"``, or the ``"preview"`` of a version."""
    return "fine" if fine else "preview"


def target(project: Project, kind: Export, name: str, ordered: Sequence[str] = ()) -> Path:
    """A free file for an export; those that are ``ordered`` are not there yet."""
    folder = project.folder / "exports"
    folder.mkdir(parents=True, exist_ok=True)
    stem = folder_name(name or project.folder.name)
    taken = [one.lower() for one in (*(path.name for path in folder.iterdir()), *ordered)]
    # The ending says what the file holds: numbers go before it. A quilt's goes on.
    ending, count, found = kind.ending, 1, stem
    while any(one == f"{found}{ending}".lower() or (one.startswith(f"{found}_qs".lower())
              and kind.name == "quilt") for one in taken):
        count += 1
        found = f"{stem}-{count}"
    return folder / f"{found}{ending}"


def entries(project: Project) -> list[dict[str, Any]]:
    """What was exported, the newest last; each has a record beside it."""
    found = []
    for record in (project.own / "exports").glob("*.json"):
        try:
            data = read_json(record)
            path = project.folder / "exports" / data["file"]
            state = path.stat()
        except (UserError, OSError, KeyError, TypeError):
            continue
        number = id_of(path.name)
        found.append({
            "id": number, "name": path.name, "kind": data.get("kind"),
            "version": data.get("version"), "size_bytes": state.st_size,
            "created": data.get("created", state.st_mtime), "fine": data.get("fine", False),
            "quality": quality_of(data.get("fine", False)),
            "file": f"/api/projects/{project.id}/exports/{number}/file", "path": str(path),
            "figures": data.get("figures", {})})
    return sorted(found, key=lambda one: one["created"])


def find(project: Project, export: str) -> Path:
    """The file of an export, by its id."""
    for one in entries(project):
        if one["id"] == export:
            return Path(one["path"])
    raise Refusal("not_found", "there is no such export any more")


def keep(project: Project, facts: dict[str, Any]) -> None:
    """Write the record of an export."""
    name = str(facts["file"])
    write_json(project.own / "exports" / f"{id_of(name)}.json",
               {**facts, "created": round(time.time(), 3)})


def forget_unfinished(target: Path, since: float = 0.0) -> None:
    """Remove what a process that was killed has left of a file (`lfportrait.files.atomic_path`).

    Of a folder, what it has left of any file in there, if that is no older than ``since`` (seconds,
    as `time.time`): other hidden files are a person's.
    """
    inside = target.is_dir()
    folder, name, ending = target.parent, re.escape(target.stem), re.escape(target.suffix)
    if target.stem.endswith("_qs"):  # a quilt's name goes on, and its settings lie beside it
        name, ending = rf"{name}(\d+x\d+a[\d.]+({ending})?)?", rf"({ending}|\.json)"
    if inside:
        folder, name, ending = target, r"[^.].*", r"(\.\w+)?"
    mine = re.compile(rf"\.{name}\.{MARK}{ending}")
    for path in folder.glob(".*"):
        with contextlib.suppress(OSError):  # one that is open in another program stays
            if not mine.fullmatch(path.name) or path.lstat().st_mtime < since:
                continue
            if not path.is_dir():
                path.unlink()
            elif not inside:
                shutil.rmtree(path)


def remove(project: Project, export: str) -> None:
    """Delete an export and its record; a quilt with the settings that lie beside it."""
    path = find(project, export)
    path.unlink(missing_ok=True)
    path.with_name(f"{path.name}.json").unlink(missing_ok=True)
    (project.own / "exports" / f"{export}.json").unlink(missing_ok=True)
