"""Selections for the commands `lfportrait batch` and `lfportrait study`."""

from __future__ import annotations

import json
import shlex
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files import write_bytes
from ..media.kinds import VIDEOS
from .answers import Refusal, folder_name, free_name, free_place, text
from .projects import Project
from .styles import Style
from .versions import Version, Versions

if TYPE_CHECKING:
    from .desk import Desk

_MOST = 1000


def _words(data: dict[str, Any], field: str) -> list[str]:
    value = data.get(field) or []
    if not isinstance(value, list) or len(value) > _MOST or not all(
            isinstance(one, str) for one in value):
        raise Refusal("bad_request", f"{field} must be a list of ids", field=field)
    return list(dict.fromkeys(value))


def _versions(desk: Desk, data: dict[str, Any]) -> list[tuple[Project, Version]]:
    """The versions of a selection: pairs of a project and a version."""
    value = data.get("versions") or []
    if not isinstance(value, list) or len(value) > _MOST or not all(
            isinstance(one, list) and len(one) == 2 for one in value):
        raise Refusal("bad_request", "versions must be a list of [project, version]",
                      field="versions")
    found = []
    for one, version in value:
        project = desk.projects.get(str(one))
        found.append((project, Versions(project).get(str(version))))
    return found


def _inside(folder: Path, path: Path) -> str:
    """A path as a file in ``folder`` names it."""
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)


def _table(kind: str, **entries: Any) -> str:
    """A table of a TOML file; its texts and lists are written as JSON has them."""
    lines = [f"{name} = {json.dumps(value, ensure_ascii=False)}" for name, value in entries.items()]
    return "\n".join([f"[[{kind}]]", *lines])


def batch_file(desk: Desk, data: dict[str, Any]) -> dict[str, Any]:
    """Write a jobs file (`lfportrait.job.batch`) of a selection.

    ``data`` has ``projects``, ``styles`` and ``displays``, ids each, and ``versions``: sitters in
    the style of a version, in its strength and with the regions that it keeps. The answer has
    ``file``, its ``text``, the ``command`` that takes it, the folder ``out`` of its results, and
    ``notes``: what of the versions a batch can't do.
    """
    folder = desk.projects.folder
    projects = {one: desk.projects.get(one) for one in _words(data, "projects")}
    styles, notes = _Styles(folder), []
    wanted: dict[str, list[str]] = {}
    for number, project in projects.items():
        wanted[number] = [styles.name(desk.styles.get(one, project), {})
                          for one in _words(data, "styles")]
    for project, version in _versions(desk, data):
        if version.style is None:
            raise Refusal("exists", f"{version.name} was made by the command line, by a painting "
                          "that is not in the gallery: choose versions that were painted here")
        projects[project.id] = project
        wanted.setdefault(project.id, []).append(
            styles.name(desk.styles.get(version.style, project), version.mix))
        if left := sorted(set(version.mix) - {"strength", "keep"}):
            notes.append(f"the batch paints {version.name} without its {', '.join(left)}: "
                         "lfportrait restyle adds that to its styled.npz")
    if not projects or not any(wanted.values()):
        raise Refusal("bad_request", "choose at least one sitter and one painting", field="styles")
    tables: list[str] = []
    sitters: list[str] = []
    for number, project in projects.items():
        sitters.append(_folder(project.folder.name, sitters))
        tables.append(_table("sitter", name=sitters[-1], **_photos(folder, project),
                             styles=list(dict.fromkeys(wanted[number]))))
    tables += styles.tables
    panels: list[str] = []
    for one in _words(data, "displays") or ["generic-4k"]:
        panel = desk.displays.get(one)
        panels.append(_folder(panel.display.name, panels))
        tables.append(_table("display", name=panels[-1], panel=panel.id
                             if panel.path is None else _inside(folder, panel.path)))
    contents = "\n\n".join(tables) + "\n"
    path = free_place(folder, "jobs.toml")
    write_bytes(path, contents.encode())
    out = path.with_name(f"{path.stem}-results")
    return {"file": str(path), "text": contents, "out": str(out), "notes": notes,
            "command": shlex.join(["lfportrait", "batch", str(path), "--out", str(out)])}


def _photos(folder: Path, project: Project) -> dict[str, str]:
    """Where a sitter's photos are, as the file says it."""
    if not project.files():
        raise Refusal("not_ready", f"{project.name} has no photos, which a batch begins with: "
                      "add some, or choose other sitters", needs="photos")
    source = "video" if project.source.suffix.lower() in VIDEOS else "photos"
    return {source: _inside(folder, project.source)}


class _Styles:
    """The styles of a jobs file: paintings, each in the mixtures that are wanted."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._names: dict[tuple[str, str], str] = {}
        self.tables: list[str] = []

    def name(self, style: Style, mix: dict[str, Any]) -> str:
        """The name in the file; the same id may be another painting in another project."""
        chosen = {name: mix[name] for name in ("strength", "keep") if name in mix}
        key = style.source, json.dumps(chosen)
        if key not in self._names:
            called = style.name
            if "strength" in chosen:
                called += f" at {round(100 * chosen['strength'])} percent"
            if "keep" in chosen:
                called += f" but {', '.join(chosen['keep'])}"
            self._names[key] = _folder(called, self._names.values())
            self.tables.append(_table(
                "style", name=self._names[key], painting=style.name if style.path is None
                else _inside(self._folder, style.path),
                **{f"stylize.{name}": value for name, value in chosen.items()}))
        return self._names[key]


def _folder(name: str, taken: Collection[str]) -> str:
    """A name as a batch has it for a folder of its results: free, and none of its own files'."""
    from ..job.batch import TAKEN  # slow: the server can do without it until then

    clean = folder_name(name)
    if clean.startswith("quilt_"):
        clean = f"the {clean}"
    return free_name(clean, [*TAKEN, *taken])


def study_command(desk: Desk, data: dict[str, Any]) -> dict[str, Any]:
    """The command that compares versions in a study: those that are fine have the videos for it.

    ``data`` has ``versions``, pairs of a project and a version, and ``title``; the answer ``file``,
    its ``text``, which is the ``command``, and the ``page`` that it makes.
    """
    pairs = _versions(desk, data)
    if len(pairs) < 2:
        raise Refusal("bad_request", "choose at least two versions to compare", field="versions")
    entries, paintings = [], dict[str, Style]()
    groups: dict[tuple[str, str], list[str]] = {}
    for project, version in pairs:
        video = version.folder / "sweep.mp4"
        if not version.fine or not video.is_file():
            raise Refusal("not_ready", f"make {version.name} of {project.name} fine first: a study "
                          "shows its video", needs="styled")
        painting = _painting(desk, project, version)
        if not _same(painting, paintings.setdefault(painting.name, painting)):
            raise Refusal("bad_name", f"a study can't show two paintings called {painting.name!r}: "
                          "add one of them under another name", name=painting.name)
        group = groups.setdefault((project.id, painting.name), [])
        # Names may be there twice, and differ in signs alone that a study leaves out.
        group.append(free_name(_word(version.name), group))
        entries.append((group[-1], project, painting, video))
    for (number, _), names in groups.items():
        if len(names) < 2:
            raise Refusal("bad_request", f"{names[0]} of {desk.projects.get(number).name} has "
                          "nothing to be compared with: choose two versions of a sitter in the "
                          "same painting", field="versions")
    # A sitter who is called like a painting would have its picture for her photo.
    words = ["lfportrait", "study", *(
        f"{method}:{free_name(_sitter_word(pairs, project), paintings)}:{painting.name}={video}"
        for method, project, painting, video in entries)]
    out = free_place(desk.projects.folder, "study")
    words += ["--out", str(out)]
    title = text(data, "title", "")
    if title:
        words += ["--title", title]
    pictures = [str(one.path) for one in paintings.values() if one.path is not None]
    if pictures:
        words += ["--pictures", *pictures]
    command = shlex.join(words)
    script = free_place(desk.projects.folder, "study.txt")
    write_bytes(script, f"{command}\n".encode())
    return {"file": str(script), "text": f"{command}\n", "command": command,
            "page": str(out / "index.html")}


def _painting(desk: Desk, project: Project, version: Version) -> Style:
    """The painting of a version, which a study shows under the name of its file."""
    every = desk.styles.all(project)
    found = next((one for one in every if one.id == version.style or (
        version.style is None and one.name == version.name)), None)
    if found is None:
        raise Refusal("not_found", f"the painting of {version.name} is not in the gallery, and a "
                      "study shows it: choose versions that were painted here")
    if found.name != _word(found.name):
        raise Refusal("bad_name", f"a study can't show {found.name!r}: add the picture under a "
                      "name without : = and /", name=found.name)
    return found


def _same(one: Style, other: Style) -> bool:
    """Whether two styles are one painting: sitters may have a copy each."""
    return one.source == other.source or (
        one.path is not None and other.path is not None
        and one.path.read_bytes() == other.path.read_bytes())


def _sitter_word(pairs: list[tuple[Project, Version]], project: Project) -> str:
    """A sitter's name in a study; two may be called the same."""
    names = {one.id: _word(one.name) for one, _ in pairs}
    alike = sum(name == names[project.id] for name in names.values()) > 1
    return _word(project.folder.name if alike else project.name)


def _word(name: str) -> str:
    """A name in a study: what separates names there is left out."""
    return "".join(" " if sign in ":=/" else sign for sign in name).strip() or "portrait"
