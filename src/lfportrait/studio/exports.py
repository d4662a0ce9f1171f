"""What a portrait can be exported as, and what was exported."""

from __future__ import annotations

import contextlib
import re
import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..files import read_json, write_json
from ..leftovers import MARK
from .answers import Refusal, choice, number, text, truth, whole
from .names import folder_name, id_of
from .projects import Project

__all__ = ["KINDS", "Kind", "checked_options", "checked_placement", "entries", "find",
           "forget_unfinished", "keep", "kinds", "quality_of", "remove", "target"]


@dataclass(frozen=True)
class Kind:
    """One kind of export.

    Attributes
    ----------
    kind, title, purpose
        For the page.
    ending
        Of the file's name: what stands after the name that was chosen.
    megabytes
        It takes about, as measured on a head of 64 photos.
    needs_display
        Whether it is made for a panel.
    options
        Other parameters: name, type, default, and bounds or choices.
    """

    kind: str
    title: str
    purpose: str
    ending: str
    megabytes: float
    needs_display: bool = False
    options: tuple[dict[str, Any], ...] = ()

    def entry(self) -> dict[str, Any]:
        """As the page sees it."""
        return {"kind": self.kind, "title": self.title, "purpose": self.purpose,
                "suffix": Path(f"x{self.ending}").suffix,
                "about_bytes": round(1e6 * self.megabytes), "needs_display": self.needs_display,
                "options": list(self.options)}


def _number(name: str, default: float, low: float, high: float) -> dict[str, Any]:
    return {"name": name, "type": "number", "default": default, "choices": None, "min": low,
            "max": high}


def _whole(name: str, default: int, low: int, high: int) -> dict[str, Any]:
    return {**_number(name, default, low, high), "type": "whole"}


def _choice(name: str, default: str, *choices: str) -> dict[str, Any]:
    return {"name": name, "type": "choice", "default": default, "choices": list(choices),
            "min": None, "max": None}


def _text(name: str) -> dict[str, Any]:
    return {"name": name, "type": "text", "default": "", "choices": None, "min": None, "max": None}


_MOTION = (_whole("frames", 120, 2, 3600), _number("fps", 30, 1, 120), _number("sway", 12, 0, 90))
KINDS = {one.kind: one for one in (
    Kind("coded", "Coded picture", "Shown on a light-field panel, pixel for pixel, unscaled",
         ".png", 16, True),
    Kind("quilt", "Quilt", "All views as tiles, for Looking Glass Bridge and Studio", "_qs.png", 12,
         True),
    Kind("hop", "Looking Glass Studio package", "Opened by Looking Glass Studio", ".hop", 12, True),
    Kind("page", "Page", "One HTML file that anybody can open and turn in a browser", ".html", 5,
         False, (_text("title"), _text("artist"), _text("date"),
                 _number("max_size", 6, 0.1, 1000))),
    Kind("sweep", "Video", "A video in which the head turns", ".mp4", 1, True,
         (_whole("size", 512, 64, 2160), _whole("frames", 90, 2, 3600))),
    Kind("flat", "Video for flat hologram-like panels", "Upright, 2160 x 3840, HEVC", ".mp4", 5,
         False, _MOTION),
    Kind("stereo", "Stereo pair", "For 3D televisions, VR viewers and spatial photos", "_2x1.jpg",
         3, False, (_number("eye_distance", 63, 0, 1000),)),
    Kind("anaglyph", "Anaglyph", "For red and cyan glasses", "_anaglyph.png", 4, False,
         (_number("eye_distance", 63, 0, 1000),)),
    Kind("rgbd", "Color and depth", "For programs that make views of a depth map", "_rgbd.png", 5),
    Kind("glb", "Textured mesh, GLB", "For Blender, web pages and most 3D programs", ".glb", 17),
    Kind("usdz", "Textured mesh, USDZ", "For Quick Look on iPhone, iPad and Mac", ".usdz", 33),
    Kind("obj", "Textured mesh, OBJ", "For older 3D programs; with its material and its picture",
         "-obj.zip", 14),
    Kind("ply", "Points, PLY", "For MeshLab and CloudCompare", ".ply", 20),
    Kind("splats_ply", "Gaussian splats, PLY", "For viewers of Gaussian splats", "-splats.ply", 27),
    Kind("spz", "Gaussian splats, SPZ", "Small; for Niantic's and other viewers", ".spz", 6),
    Kind("sog", "Gaussian splats, SOG", "Small; for PlayCanvas", ".sog", 4),
    Kind("print", "Lenticular print", "A page to print behind a lens sheet", ".tiff", 160, False, (
        _number("lpi", 60, 10, 200), _number("dpi", 720, 100, 4800), _text("size"))),
    Kind("field", "Field", "For the commands, with all its styles", "-styled.npz", 25),
    Kind("checkpoint", "Checkpoint, svox2", "For research code that reads svox2's fields", ".npz",
         11))}
_PLACEMENT = {"size": (0.05, 4.0), "shift_x": (-4.0, 4.0), "shift_y": (-4.0, 4.0),
              "focus": (-4.0, 4.0), "depth_scale": (0.01, 4.0), "turn": (-180.0, 180.0),
              "ground_depth": (0.0, 20.0), "background": (0.0, 1.0), "shadow": (0.0, 1.0),
              "ground_blur": (0.0, 10.0)}


def kinds() -> list[dict[str, Any]]:
    """All kinds as the page sees them."""
    return [one.entry() for one in KINDS.values()]


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


def checked_options(kind: Kind, data: Any) -> dict[str, Any]:
    """The options of an export, with their defaults."""
    data = {} if data is None else data
    names = [one["name"] for one in kind.options]
    if not isinstance(data, dict) or not set(data) <= {*names}:
        raise Refusal("bad_request", f"{kind.kind} takes {', '.join(names) or 'no options'}",
                      field="options")
    found: dict[str, Any] = {}
    for one in kind.options:
        name = one["name"]
        if one["type"] == "text":
            found[name] = text(data, name, "")
        elif one["type"] == "choice":
            found[name] = choice(data, name, tuple(one["choices"]), one["default"])
        elif one["type"] == "whole":
            found[name] = whole(data, name, one["min"], one["max"], one["default"])
        else:
            found[name] = number(data, name, one["min"], one["max"], one["default"])
    return found


def quality_of(fine: bool) -> str:
    """What is exported: ``"fine"``, or the ``"preview"`` of a version."""
    return "fine" if fine else "preview"


def target(project: Project, kind: Kind, name: str, ordered: Sequence[str] = ()) -> Path:
    """A free file for an export; those that are ``ordered`` are not there yet."""
    folder = project.folder / "exports"
    folder.mkdir(parents=True, exist_ok=True)
    stem = folder_name(name or project.folder.name)
    taken = [one.lower() for one in (*(path.name for path in folder.iterdir()), *ordered)]
    # The ending says what the file holds: numbers go before it. A quilt's goes on.
    ending, count, found = kind.ending, 1, stem
    while any(one == f"{found}{ending}".lower() or (one.startswith(f"{found}_qs".lower())
              and kind.kind == "quilt") for one in taken):
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
