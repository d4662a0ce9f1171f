"""Selections for the commands `lfportrait batch` and `lfportrait study`."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files import VIDEOS, atomic_write
from .answers import Refusal, text
from .projects import Project
from .styles import Style
from .versions import Version, Versions

if TYPE_CHECKING:
    from .desk import Desk

__all__ = ["batch_file", "study_command"]

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
    lines = [f"{name} = {json.dumps(value, ensure_ascii=False)}"
             for name, value in entries.items()]
    return "\n".join([f"[[{kind}]]", *lines])


def batch_file(desk: Desk, data: dict[str, Any]) -> dict[str, Any]:
    """Write a jobs file (`lfportrait.job.batch`) of a selection.

    Parameters
    ----------
    desk
        The studio.
    data
        ``projects``, ``styles`` and ``displays``, ids each; ``versions``: sitters in the style of a
        version.

    Returns
    -------
    answer
        ``file``, its ``text``, and the ``command`` that takes it.
    """
    folder = desk.projects.folder
    projects = {one: desk.projects.get(one) for one in _words(data, "projects")}
    pairs = _versions(desk, data)
    every = _words(data, "styles")
    styles: dict[str, Style] = {}
    wanted: dict[str, list[str]] = {name: list(every) for name in projects}
    for project, version in pairs:
        if version.style is None:
            raise Refusal("exists", f"{version.name} was made by the command line, by a painting "
                          "that is not in the gallery: choose versions that were painted here")
        projects[project.id] = project
        wanted.setdefault(project.id, []).append(version.style)
    if not projects or not any(wanted.values()):
        raise Refusal("bad_request", "choose at least one sitter and one painting", field="styles")
    names: dict[tuple[str, str], str] = {}
    for number, project in projects.items():
        project.need("photos")
        for one in wanted[number]:
            style = desk.styles.get(one, project)
            # The same id may be another painting in another project.
            names[number, one] = _name(styles, style)
    tables = [_table("sitter", name=project.folder.name,
                     **{"video" if project.source.suffix.lower() in VIDEOS else "photos":
                        _inside(folder, project.source)},
                     styles=list(dict.fromkeys(names[number, one] for one in wanted[number])))
              for number, project in projects.items()]
    tables += [_table("style", name=name, painting=style.name if style.path is None
                      else _inside(folder, style.path)) for name, style in styles.items()]
    for one in _words(data, "displays") or ["generic-4k"]:
        panel = desk.displays.get(one)
        tables.append(_table("display", name=panel.display.name, panel=panel.id
                             if panel.path is None else _inside(folder, panel.path)))
    contents = "\n\n".join(tables) + "\n"
    path = _free(folder, "jobs", ".toml")
    with atomic_write(path) as stream:
        stream.write(contents.encode())
    out = path.with_name(f"{path.stem}-results")
    return {"file": str(path), "text": contents,
            "command": shlex.join(["lfportrait", "batch", str(path), "--out", str(out)])}


def _name(styles: dict[str, Style], style: Style) -> str:
    """The name of a painting in the file, which no other one has."""
    name, count = style.name, 1
    while name in styles and styles[name].source != style.source:
        count += 1
        name = f"{style.name}-{count}"
    styles[name] = style
    return name


def _free(folder: Path, stem: str, suffix: str) -> Path:
    path, count = folder / f"{stem}{suffix}", 1
    while path.exists():
        count += 1
        path = folder / f"{stem}-{count}{suffix}"
    return path


def study_command(desk: Desk, data: dict[str, Any]) -> dict[str, Any]:
    """The command that compares versions in a study: those that are fine have the videos for it.

    Parameters
    ----------
    desk
        The studio.
    data
        ``versions``: pairs of a project and a version; ``title``.
    """
    pairs = _versions(desk, data)
    if len(pairs) < 2:
        raise Refusal("bad_request", "choose at least two versions to compare", field="versions")
    words, pictures = ["lfportrait", "study"], []
    for project, version in pairs:
        video = version.folder / "sweep.mp4"
        if not version.fine or not video.is_file():
            raise Refusal("not_ready", f"make {version.name} of {project.name} fine first: a study "
                          "shows its video", needs="styled")
        style = version.name
        if version.style is not None:
            painting = desk.styles.get(version.style, project)
            style = painting.name
            if painting.path is not None:
                pictures.append(str(painting.path))
        words.append(f"{_word(version.name)}:{_word(project.name)}:{style}={video}")
    out = _free(desk.projects.folder, "study", "")
    words += ["--out", str(out)]
    title = text(data, "title", "")
    if title:
        words += ["--title", title]
    if pictures:
        words += ["--pictures", *dict.fromkeys(pictures)]
    command = shlex.join(words)
    script = _free(desk.projects.folder, "study", ".txt")
    with atomic_write(script) as stream:
        stream.write(f"{command}\n".encode())
    return {"file": str(script), "text": f"{command}\n", "command": command}


def _word(name: str) -> str:
    """A name in a study: what separates names there is left out."""
    return "".join(" " if sign in ":=/" else sign for sign in name).strip() or "portrait"
