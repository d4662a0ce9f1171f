"""What all commands share: their options, those of other packages' methods, and the short help.

``--help`` shows the common options, ``--help-all`` all of them. tyro lists each option of a
command's configurations, of which `make` has some two hundred. What is shown at first are the
command's own options and those that it calls `usual`: the others are hidden by tyro's ``Suppress``.
(tyro's compact help shows all options, without what they do.)
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, make_dataclass
from dataclasses import field as option
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, get_args, get_origin, get_type_hints

import tyro

from ..plugins import offered
from ..progress import Outlook, Progress

_HIDDEN: Any = tyro.conf.Suppress
_MOST = 16  # A command with no more options than this shows all of them.


def print_short_help(command: type, program: str) -> None:
    """Print a command's help without the options that few people need."""
    names = set(_options(command))
    usual = names if len(names) <= _MOST else _usual(command)
    try:
        tyro.cli(_with(command, usual), args=["--help"], prog=program)
    except SystemExit:
        if names - usual:
            print(f"More options: {program} --help-all")


def _usual(command: Any) -> set[str]:
    """Names of a command's own options, and of those that it names."""
    above = {field.name for base in command.__mro__[1:] if dataclasses.is_dataclass(base)
             for field in dataclasses.fields(base)}
    own = {field.name for field in dataclasses.fields(command)} - above
    return {name.replace("_", "-") for name in ("quiet", *own, *command.usual)}


def _entries(kind: Any, prefix: str) -> Iterator[tuple[Any, Any, str, Any]]:
    """Field, type, name as an option, and the data class it is, if any, of each entry."""
    hints = get_type_hints(kind, include_extras=True)
    for field in dataclasses.fields(kind):
        hint = hints[field.name]
        plain, marks = (get_args(hint)[0], get_args(hint)[1:]) if (
            get_origin(hint) is Annotated) else (hint, ())
        given = [mark.name for mark in marks if getattr(mark, "name", None) is not None]
        name = prefix + (given or [field.name.replace("_", "-")])[0]
        yield field, hint, name, plain if dataclasses.is_dataclass(plain) else None


def _below(name: str) -> str:
    """What stands before the names of an entry's own entries."""
    return f"{name}." if name else ""


def _options(kind: Any, prefix: str = "") -> Iterator[str]:
    """The names of a class's options, of those of its entries, too."""
    for _, hint, name, inner in _entries(kind, prefix):
        if _HIDDEN[int].__metadata__[0] in getattr(hint, "__metadata__", ()):
            continue
        if inner is not None:
            yield from _options(inner, _below(name))
        else:
            yield name


def _with(kind: Any, usual: set[str], prefix: str = "", values: Any = None) -> Any:
    """A class that shows these options alone; the defaults are its own, or an object's values."""
    entries: list[Any] = []
    for field, hint, name, inner in _entries(kind, prefix):
        factory = field.default_factory
        if values is not None:
            factory = partial(getattr, values, field.name)
        if inner is not None and {*_options(inner, _below(name))} & usual:
            needed = factory is dataclasses.MISSING  # one of its own options must be given
            shown = _with(inner, usual, _below(name), None if needed else factory())
            marks = getattr(hint, "__metadata__", (None,))
            entries.append((field.name, Annotated[(shown, *marks)], dataclasses.field(
                default_factory=dataclasses.MISSING if needed else shown, kw_only=field.kw_only)))
        elif name not in usual or values is not None:
            entries.append((
                field.name, hint if name in usual else _HIDDEN[hint],
                dataclasses.field(default_factory=factory) if values is not None else field))
    return make_dataclass(kind.__name__, entries, bases=(kind,),
                          frozen=kind.__dataclass_params__.frozen,
                          namespace={"__doc__": kind.__doc__})


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
        from ..simd.host import compiling_progress

        return compiling_progress(title, total, not self.quiet, outlook)

    def run(self) -> dict[str, Any]:
        """Do it; the figures that ``--json`` writes."""
        raise NotImplementedError

    def exit_code(self, figures: dict[str, Any]) -> int:
        """The exit code of a run that came to its end with these figures: 0."""
        return 0


def parsed(command: type[Common], arguments: Sequence[str], program: str) -> Common:
    """A command of a class with the options of the words after its name.

    Each of its `sections` adds its fields as options, ``--NAME.FIELD``; what differs from the
    defaults is `given`. ``program`` is how help calls it.
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
