"""Short help: ``--help`` shows the common options, ``--help-all`` all of them.

tyro lists each option of a command's configurations, of which `make` has some two hundred. What is
shown at first are the command's own options and those that it calls `usual`: the others are hidden
by tyro's ``Suppress``. (tyro's compact help shows all options, without what they do.)
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import make_dataclass
from functools import partial
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import tyro

__all__ = ["print_short_help"]

_HIDDEN: Any = tyro.conf.Suppress
_MOST = 16
"""A command with no more options than this shows all of them."""


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
            shown = _with(inner, usual, _below(name), factory())
            marks = getattr(hint, "__metadata__", (None,))
            entries.append((field.name, Annotated[(shown, *marks)],
                            dataclasses.field(default_factory=shown)))
        elif name not in usual or values is not None:
            entries.append((
                field.name, hint if name in usual else _HIDDEN[hint],
                dataclasses.field(default_factory=factory) if values is not None else field))
    return make_dataclass(kind.__name__, entries, bases=(kind,),
                          frozen=kind.__dataclass_params__.frozen,
                          namespace={"__doc__": kind.__doc__})
