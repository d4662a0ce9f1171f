"""Options of all commands, and those of methods from other packages."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, make_dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from ..plugins import offered
from ..progress import Outlook, Progress
from .short_help import print_short_help

__all__ = ["Common", "parsed"]


@dataclass(kw_only=True)
class Common:
    """Options that every command has."""

    groups: ClassVar[dict[str, str]] = {}
    """Groups of entry points (`lfportrait.plugins`) whose parameters are options, too, by what
    stands before their names."""
    given: ClassVar[tuple[Any, ...]] = ()
    """Values of these parameters that differ from the defaults."""
    usual: ClassVar[tuple[str, ...]] = ()
    """Options of its configurations that ``--help`` shows beside its own; ``--help-all`` shows
    all."""

    device: Annotated[str, tyro.conf.arg(metavar="auto|cpu|gpu|gpu:NAME")] = "auto"
    """Where to compute: auto is a GPU, if there is one, else the CPU (see lfportrait devices)."""
    seed: int = 0
    """Seed of all random choices; the same seed on the same machine gives the same files."""
    quiet: bool = False
    """Print no progress."""
    json: Path | None = None
    """Write the figures of the run (times, sizes, metrics) to this file."""

    @classmethod
    def sections(cls) -> dict[str, type]:
        """Parameters that are options, too, by what stands before their names: of its `groups`."""
        return {f"{prefix}{name}": method.parameters for prefix, group in cls.groups.items()
                for name, method in offered(group).items()}

    def progress(self, title: str, total: int = 0, outlook: Outlook | None = None,
                 ) -> AbstractContextManager[Progress]:
        """A progress line, silent with ``--quiet``; it also shows the compilation of kernels."""
        from ..lanes.compiling import compiling_progress

        return compiling_progress(title, total, not self.quiet, outlook)

    def run(self) -> dict[str, Any]:
        """Do it.

        Returns
        -------
        figures
            What ``--json`` writes.
        """
        raise NotImplementedError

    def exit_code(self, figures: dict[str, Any]) -> int:
        """The exit code of a run that came to its end with these figures: 0."""
        return 0


def parsed(command: type[Common], arguments: Sequence[str], program: str) -> Common:
    """A command with the options of these words.

    Parameters
    ----------
    command
        Its class. Each of its `sections` adds its fields as options, ``--NAME.FIELD``; what
        differs from the defaults is `given`.
    arguments
        The words after the command's name.
    program
        How help calls it.
    """
    if {"-h", "--help"} & {*arguments} and "--help-all" not in arguments:
        print_short_help(command, program)
        raise SystemExit(0)
    arguments = ["--help" if word == "--help-all" else word for word in arguments]
    kinds = command.sections()
    places = {f"given_{number}": kind for number, kind in enumerate(kinds.values())}
    if not kinds:
        return tyro.cli(command, args=arguments, prog=program)
    entries: list[Any] = [
        (place, Annotated[kind, tyro.conf.arg(name=name)], option(default_factory=kind))
        for (place, kind), name in zip(places.items(), kinds, strict=True)]
    whole = make_dataclass(command.__name__, entries, bases=(command,), kw_only=True,
                           namespace={"__doc__": command.__doc__})
    found: Any = tyro.cli(whole, args=arguments, prog=program)
    given = (getattr(found, place) for place in places)
    found.given = tuple(one for one in given if one != type(one)())
    return found  # type: ignore[no-any-return]
