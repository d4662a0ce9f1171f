"""What installed packages bring, found by their entry points (docs/plugins.md).

A package names what it brings under ``[project.entry-points]`` in its ``pyproject.toml``. This one
offers its own painted exemplars and modelled heads in the same way.

* ``lfportrait.commands``: data classes of the command line (`lfportrait.cli.Common`); a dot in the
  name stands for the space in a command of two words;
* ``lfportrait.transfer_methods``: methods that paint a photo (`lfportrait.example.PhotoMethod`);
* ``lfportrait.field_methods``: methods that color a field (`lfportrait.stylize.FieldMethod`);
* ``lfportrait.styles``: functions of no argument that give functions that make exemplars, by name;
* ``lfportrait.sittings``: functions (count, height, seed) that give photos with landmarks;
* ``lfportrait.exports``: kinds of files that a portrait is exported as (`lfportrait.share.Export`);
* ``lfportrait.formats``: formats of captures (`lfportrait.capture.CaptureFormat`).

Reading the entry points takes 20 to 50 ms: what is asked for by its own name never does.
"""

import functools
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

from tyro.constructors import PrimitiveConstructorSpec

from .arrays import Float64, UInt8
from .errors import UserError

Sitting = tuple[UInt8, Float64]
"""A photo, uint8 [H, W, 3], and its landmarks [68, 2]."""


class Registered(Protocol):
    """What a registry holds."""

    name: ClassVar[str]

    def check(self) -> None:
        """Complain of a class that can't be used."""


Kind = TypeVar("Kind", bound=Registered)


@functools.cache
def offered(group: str) -> dict[str, Any]:
    """Entry points of a group by name; those that can't be loaded are left out."""
    found = {}
    for entry in sorted(entry_points(group=group), key=lambda entry: entry.name):
        try:
            found[entry.name] = entry.load()
        except Exception as error:  # whatever it does while it is imported
            warnings.warn(f"{entry.name} ({entry.value}) is left out: {error}", stacklevel=2)
    return found


def gathered(group: str, base: type[Kind], own: Iterable[type[Kind]]) -> dict[str, Kind]:
    """A registry: an instance of each of our own classes and of those of a group, by its name.

    A class of another package that can't be used, as it is no subclass of ``base``, or whose
    name there is already, is left out with a warning.
    """
    found = {one.name: one for one in (kind() for kind in own)}
    for name, kind in offered(group).items():
        try:
            if not (isinstance(kind, type) and issubclass(kind, base)):
                raise TypeError(f"it is no subclass of {base.__name__}")
            one = kind()
            one.check()
            if one.name in found:
                raise ValueError(f"there is {one.name} already")
        except Exception as error:
            warnings.warn(f"{name} ({group}) is left out: {_line(error)}", stacklevel=2)
        else:
            found[one.name] = one
    return found


@contextmanager
def blamed(thing: object) -> Iterator[None]:
    """Whatever fails in another package's ``thing`` becomes one line; our own faults stay ours."""
    package = type(thing).__module__.partition(".")[0]
    try:
        yield
    except Exception as error:
        if isinstance(error, UserError) or package == __name__.partition(".")[0]:
            raise
        reason = _line(error) + _place(error, package)
        raise UserError(f"{type(thing).__name__} of the package {package} failed: "
                        f"{type(error).__name__}: {reason}") from error


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


def _place(error: Exception, package: str) -> str:
    """The last line of a package's own code that an error came through, as " (FILE, line N)"."""
    lines = [f" ({Path(frame.f_code.co_filename).name}, line {number})"
             for frame, number in traceback.walk_tb(error.__traceback__)
             if str(frame.f_globals.get("__name__")).partition(".")[0] == package]
    return lines[-1] if lines else ""


def chosen(group: str, name: str, own: tuple[str, ...] = ()) -> Any:
    """The entry point of a name; ``own`` are the names that need none."""
    found = offered(group)
    if name not in found:
        raise UserError(f"there is no method {name!r}; the installed ones are "
                        f"{', '.join((*own, *found))}")
    return found[name]


def provided_styles() -> dict[str, Callable[[], Any]]:
    """The installed exemplars: for each name what makes its `lfportrait.example.Exemplar`."""
    return {name: make for makers in offered("lfportrait.styles").values()
            for name, make in makers().items()}


def provided_sittings(count: int, height: int, seed: int) -> list[Sitting]:
    """Photos, ``height`` pixels high, with landmarks, from installed packages or a `UserError`."""
    for make in offered("lfportrait.sittings").values():
        found: list[Sitting] = make(count, height, seed)
        return found
    raise UserError("there are no photos to train on; give a folder with portraits, or install the "
                    "package (`pip install lfportrait`) instead of running it from its sources")


class Choice(PrimitiveConstructorSpec[str]):
    """The type of an option that names a method: one of our own, or of a group of entry points.

    It stands in ``Annotated[str, Choice(...)]``. The names are looked up when the options are
    shown or read, not when the data class is defined.
    """

    def __init__(self, group: str, *own: str) -> None:
        # The base is frozen, and two of its fields are properties here.
        vars(self).update(group=group, own=own, nargs=1,
                          instance_from_str=lambda words: words[0],
                          is_instance=lambda value: isinstance(value, str),
                          str_from_instance=lambda value: [value])

    # Those of the base ask for the names, and ``Annotated`` hashes what it is given.
    __eq__ = object.__eq__
    __hash__ = object.__hash__

    @property
    def choices(self) -> tuple[str, ...]:  # type: ignore[override]
        """The names."""
        own: tuple[str, ...] = vars(self)["own"]
        return (*own, *offered(vars(self)["group"]))

    @property
    def metavar(self) -> str:  # type: ignore[override]
        """How help shows the option's value."""
        return f"{{{','.join(self.choices)}}}"
