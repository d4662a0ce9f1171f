"""What a job's process is asked for: paths and choices, and the parameters that they stand for.

The server writes orders, and imports nothing that is slow; the processes read them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UserError
from ..files import read_json
from ..lightfield import Display
from ..stages import fingerprint_files

if TYPE_CHECKING:
    from ..job import MakeConfig


def _words(config: Any, usual: Any, start: str) -> Iterator[str]:
    """Arguments for the fields of a data class that differ from another one's."""
    for one in fields(config):
        value, other = getattr(config, one.name), getattr(usual, one.name)
        name = f"{start}{one.name}".replace("_", "-")
        if value == other:
            continue
        if is_dataclass(value) and type(value) is type(other):
            yield from _words(value, other, f"{start}{one.name}.")
        elif isinstance(value, bool):
            path, _, last = name.rpartition(".")
            yield f"--{path}{'.' if path else ''}{'' if value else 'no-'}{last}"
        else:
            every = value if isinstance(value, tuple | list) else [value]
            yield from (f"--{name}", *map(str, every))


@dataclass(frozen=True)
class Order:
    """One job."""

    kind: str  # ``head``, ``fine``, ``check``, ``export`` or ``networks``.
    pictures: Path  # Folder for the stages' pictures.
    # folder, job, source: The project's, the job's (`lfportrait make --out`), and what the capture
    # is made of.
    folder: Path = Path()
    job: Path = Path()
    source: Path = Path()
    demo: bool = False  # Whether the built-in head is to be photographed first.
    # ``quick``, and ``parameters`` by their dotted names.
    options: dict[str, Any] = field(default_factory=dict)
    display: str = "generic-4k"  # A preset's name or a display file.
    # style, style_id, name: The painting (a picture or a built-in name), its id, and the project's
    # name.
    style: str = ""
    style_id: str = ""
    name: str = ""
    version: Path = Path()  # Folder of the version.
    # Arguments of `lfportrait.stylize.StyledField.mix`.
    mix: dict[str, Any] = field(default_factory=dict)
    more: dict[str, Any] = field(default_factory=dict)  # What else the kind needs.

    def panel(self) -> Display:
        """The display."""
        return Display.resolve(self.display)

    def config(self) -> MakeConfig:
        """The parameters of all stages, as `lfportrait make` has them for this display."""
        from ..job import fitted

        config = self.chosen()
        return fitted(config, [(self.panel(), config.encode)])

    def chosen(self) -> MakeConfig:
        """The parameters of all stages as they are given to `lfportrait make`."""
        from ..job import FULL, QUICK, MakeConfig
        from ..job.batch import overlaid

        quick = bool(self.options.get("quick"))
        config = QUICK.config if quick else FULL.config if self.demo else MakeConfig()
        nested: dict[str, Any] = {}
        for name, value in self.options.get("parameters", {}).items():
            place = nested
            *path, last = str(name).split(".")
            for part in path:
                place = place.setdefault(part, {})
                if not isinstance(place, dict):
                    raise UserError(f"there is no parameter {name}")
            place[last] = value
        return overlaid(config, nested, "options")

    def words(self) -> list[str]:
        """The parameters that differ from the usual ones, as arguments of `lfportrait make`."""
        from ..job import MakeConfig

        return list(_words(self.chosen(), MakeConfig(), ""))

    def inside(self, path: Path) -> str:
        """A path in the project's folder as tasks have it."""
        return path.relative_to(self.folder).as_posix() if path != self.folder else ""

    def inputs(self) -> dict[str, str]:
        """The files of the head that later stages read."""
        return {"capture": self.inside(self.job / "capture"),
                "field": self.inside(self.job / "field.npz")}

    def field_key(self) -> str:
        """Key of the field that is there, whatever it was made of."""
        try:
            return str(read_json(self.job / ".stages" / "reconstruct.json")["key"])
        except (UserError, KeyError, TypeError):
            return fingerprint_files([self.job / "field.npz"])
