"""Versions: a style and a mix under a name, in the project's folder; mixes as the page sends them.

A version is a folder ``versions/NAME/`` with ``version.json``; made fine, it also holds what
``lfportrait make`` writes. A job's folder that ``make`` itself filled is a version, too.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..files import write_json
from ..labels import GROUPS, MOST, SURFACE_LABELS
from .answers import Refusal, folder_name, free_place, id_of, number, text, truth
from .projects import Project, record_in

PORTRAIT = "portrait"  # Id of the version that `lfportrait make` wrote into the job's folder.


@dataclass(frozen=True)
class Version:
    """One version."""

    # id, folder: Of the version.
    id: str
    folder: Path
    # What ``version.json`` holds: ``name``, ``created``, ``style`` (its id), ``mix``, ``fine``
    # (stamp of what was made fine).
    data: dict[str, Any]

    @property
    def name(self) -> str:
        """For people."""
        return str(self.data.get("name") or self.id)

    @property
    def style(self) -> str | None:
        """Id of its style; None where `make` made it."""
        return self.data.get("style")

    @property
    def mix(self) -> dict[str, Any]:
        """Its mix (`lfportrait.studio.versions`)."""
        return dict(self.data.get("mix") or {})

    @property
    def from_command_line(self) -> bool:
        """Whether `make` made it."""
        return self.id == PORTRAIT

    def wanted(self) -> list[Any]:
        """What a fine version is made of, to be compared."""
        return [self.style, self.mix]

    @property
    def fine(self) -> bool:
        """Whether it is there in full."""
        if self.from_command_line:  # `stylize` alone writes no coded picture
            return self.styled.is_file()
        there = all((self.folder / name).is_file() for name in ("styled.npz", "lightfield.png"))
        return there and self.data.get("fine") == self.wanted()

    @property
    def styled(self) -> Path:
        """Its painted field, once it is fine."""
        return self.folder / "styled.npz"

    def save(self, **entries: Any) -> Version:
        """The version with other entries, written."""
        data = {**self.data, **entries}
        write_json(self.folder / "version.json", data)
        return Version(self.id, self.folder, data)


class Versions:
    """The versions of a project."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.folder = project.folder / "versions"

    def all(self) -> list[Version]:
        """All versions, the oldest first."""
        found = []
        for path in self.folder.glob("*/version.json"):
            data = record_in(path)
            if data is not None:
                found.append(Version(f"v-{id_of(path.parent.name)}", path.parent, data))
        found.sort(key=lambda version: (version.data.get("created", 0.0), version.id))
        job = self.project.job
        if (job / "styled.npz").is_file():
            run = record_in(job / "run.json") or {}
            state = (job / "styled.npz").stat()
            found.insert(0, Version(PORTRAIT, job, {
                "name": str(run.get("style") or "portrait"), "created": state.st_mtime}))
        return found

    def get(self, version: str) -> Version:
        """A version by its id."""
        found = next((one for one in self.all() if one.id == version), None)
        if found is None:
            raise Refusal("not_found", "there is no such version any more")
        return found

    def create(self, name: str, style: str, mix: dict[str, Any]) -> Version:
        """A new version."""
        folder = free_place(self.folder, folder_name(name))
        version = Version(f"v-{id_of(folder.name)}", folder, {})
        return version.save(name=name, created=round(time.time(), 3), style=style, mix=mix)

    def remove(self, version: Version) -> None:
        """Move a version into the project's trash."""
        if version.from_command_line:
            raise Refusal("exists", "this version lies in the job's folder itself and stays there")
        shutil.move(version.folder, free_place(self.project.own / "trash", version.folder.name))

    def entry(self, version: Version, job: str | None) -> dict[str, Any]:
        """A version as the page sees it."""
        styles = [value["style"] for value in version.mix.get("regions", {}).values()
                  if isinstance(value, dict)]
        stamp = f"{version.styled.stat().st_mtime_ns:x}" if version.fine else id_of(
            repr(version.wanted()))
        return {"id": version.id, "name": version.name, "created": version.data.get("created"),
                "style": version.style,
                "styles": list(dict.fromkeys([one for one in (version.style, *styles) if one])),
                "mix": version.mix, "landmarks": None, "fine": version.fine, "job": job,
                "thumbnail": f"/api/projects/{self.project.id}/versions/{version.id}/thumbnail"
                             f"?v={stamp}", "from_command_line": version.from_command_line}


def make_command(project: Project, style: str | None, display: str,
                 parameters: Sequence[str] = ()) -> str:
    """The command that makes the same portrait without the studio."""
    import shlex

    words = ["lfportrait", "make", str(project.source), "--style", style or "PAINTING", "--out",
             str(project.job)]
    if display != "generic-4k":
        words += ["--display", display]
    return shlex.join([*words, *parameters])


_REGIONS = (*SURFACE_LABELS, *GROUPS)
_KNOWN = ("strength", "identity", "regions", "keep_colors", "keep")


def checked_mix(mix: Any) -> dict[str, Any]:
    """A mix without what is as usual; `Refusal` if it is none."""
    if mix is None:
        return {}
    if not isinstance(mix, dict) or not set(mix) <= {*_KNOWN}:
        raise Refusal("bad_request", f"a mix has {', '.join(_KNOWN)} and nothing else", field="mix")
    found: dict[str, Any] = {}
    for name, usual in (("strength", 1.0), ("identity", 0.0)):
        value = number(mix, name, 0.0, 1.0, usual)
        if value != usual:
            found[name] = value
    regions = mix.get("regions") or {}
    if not isinstance(regions, dict):
        raise Refusal("bad_request", "regions must be an object", field="regions")
    chosen = {_region(name): _value(value) for name, value in regions.items()}
    if chosen := {name: value for name, value in chosen.items() if value != 1.0}:
        found["regions"] = chosen
    if truth(mix, "keep_colors"):
        found["keep_colors"] = True
    keep = mix.get("keep") or []
    if not isinstance(keep, list):
        raise Refusal("bad_request", "keep must be a list of regions", field="keep")
    if keep:
        found["keep"] = sorted({_region(name) for name in keep})
    return found


def _region(name: Any) -> str:
    if name not in _REGIONS:
        raise Refusal("bad_request", f"a region is one of {', '.join(_REGIONS)}", field="regions")
    return str(name)


def _value(value: Any) -> Any:
    if isinstance(value, dict):
        return {"style": text(value, "style"), "strength": number(value, "strength", 0, MOST, 1.0)}
    return number({"regions": value}, "regions", 0.0, MOST)


def styles_of(mix: dict[str, Any]) -> list[str]:
    """Ids of the styles that regions of a mix have of their own."""
    return sorted({value["style"] for value in mix.get("regions", {}).values()
                   if isinstance(value, dict)})


def mix_arguments(mix: dict[str, Any], style: str, name_of: Callable[[str], str],
                  ) -> tuple[dict[str, Any], dict[str, str]]:
    """Arguments of `StyledField.mix` by a mix of `checked_mix`, and the paintings of regions.

    ``style`` is the id of the style of everything else; ``name_of`` gives of an id what the
    commands call ``--style``. The paintings are named as the arguments name them.
    """
    others = {one: name_of(one) for one in styles_of(mix) if one != style}
    found = dict(mix)
    if "regions" in mix:
        found["regions"] = {
            name: ((value["style"], value["strength"]) if value["style"] in others
                   else value["strength"]) if isinstance(value, dict) else value
            for name, value in mix["regions"].items()}
    return found, others
