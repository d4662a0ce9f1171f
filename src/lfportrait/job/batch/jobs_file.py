"""The jobs file (docs/batches.md): sitters, styles, displays, parameters other than the defaults.

Parameters are those of `lfportrait make`; where several tables name one, a sitter's goes before a
style's or a display's, and these before the defaults. Paths are relative to the file.
"""

import dataclasses
import difflib
import functools
import glob
import os
import tomllib
import types
import typing
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

from ...capture import is_video
from ...errors import UserError
from ...lightfield import Display
from ...media.folders import is_junk, natural_key
from ...media.kinds import kind_of
from ...plugins import Choice
from ...stylize import StylizeConfig
from ..graph import MakeConfig

_Config = TypeVar("_Config")
_WORDS = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}


def unknown_key(where: str, key: str, known: typing.Iterable[str]) -> UserError:
    """The error for an entry that does not exist; it names what is most like it."""
    names = sorted(known)
    like = difflib.get_close_matches(key, names, 1)
    hint = f"; did you mean {like[0]}?" if like else f"; there are {', '.join(names)}"
    return UserError(f"{where}: there is no {key}{hint}")


def checked(value: Any, kind: Any, where: str) -> Any:
    """A value of a TOML file as a field of type ``kind`` takes it.

    Kinds are ``int``, ``float``, ``str``, ``bool``, a ``Literal``, a tuple of these, or one or
    None. Raises `UserError`, naming ``where``, if the value is of another type.
    """
    origin, inner = get_origin(kind), get_args(kind)
    if origin is typing.Annotated:
        names = next((mark.choices for mark in inner[1:] if isinstance(mark, Choice)), None)
        return checked(value, Literal[names] if names else inner[0], where)
    if origin in (Union, types.UnionType):
        return checked(value, next(one for one in inner if one is not type(None)), where)
    if origin is Literal:
        if value not in inner:
            raise UserError(f"{where} = {value!r} is none of {', '.join(map(str, inner))}")
        return value
    if origin is tuple:
        if not isinstance(value, list):
            raise UserError(f"{where} = {value!r} is not a list")
        if len(inner) == 2 and inner[1] is Ellipsis:
            inner = inner[:1] * len(value)
        if len(value) != len(inner):
            raise UserError(f"{where} = {value!r} is not a list of {len(inner)}")
        return tuple(checked(one, kind, where) for one, kind in zip(value, inner, strict=True))
    if kind is float and type(value) is int:
        try:
            return float(value)
        except OverflowError as error:
            raise UserError(f"{where} is too large") from error
    if type(value) is not kind:
        raise UserError(f"{where} = {value!r} is not {_WORDS[kind]}")
    return value


_types = functools.cache(functools.partial(typing.get_type_hints, include_extras=True))


def overlaid(config: _Config, table: Mapping[str, Any], where: str) -> _Config:
    """A data class of parameters with a table's entries in place of its own.

    Fields that are data classes have tables of their own; ``where`` is file and table, for
    messages. Raises `UserError` if an entry is unknown or of the wrong type.
    """
    if not table:
        return config
    kind: Any = type(config)
    hints = _types(kind)
    # A seed is the job's, not a stage's.
    known = [entry.name for entry in dataclasses.fields(config)  # type: ignore[arg-type]
             if entry.name not in ("seed", "parameters")]
    changed: dict[str, Any] = {}
    for key, value in table.items():
        if key not in known and isinstance(config, StylizeConfig) and (
                (section := config.section(key)) is not None):
            # Parameters of another package's method.
            if not isinstance(value, dict):
                raise UserError(f"{where}: {key} = {value!r} is not a table")
            section = overlaid(section, value, f"{where}.{key}")
            config = typing.cast(_Config, config.with_section(section))
            continue
        if key not in known:
            raise unknown_key(where, key, known)
        before = getattr(config, key)
        if dataclasses.is_dataclass(before):
            if not isinstance(value, dict):
                raise UserError(f"{where}: {key} = {value!r} is not a table")
            changed[key] = overlaid(before, value, f"{where}.{key}")
        else:
            changed[key] = checked(value, hints[key], f"{where}: {key}")
    return dataclasses.replace(config, **changed)  # type: ignore[type-var]


_SECTIONS = ("calibrate", "reconstruct", "stylize", "encode", "page", "keep_background",
             "sweep_size")
_FROM = "from"  # Names `MakeConfig.made_from`, as on the command line.
_SWITCHES = {"pages": bool, "sweeps": bool, "seed": int}
_SOURCES = ("photos", "video", "capture")
_STYLE_SECTIONS = ("stylize", "encode", "page", "sweep_size")
TAKEN = ("capture", "pages", "sweeps", "portrait", "sweep", "styled", "thumbnail", "photo",
         "index.html", "results.json")
"""Names of files and folders that a job writes itself."""


@dataclass(frozen=True)
class Sitter:
    """Who is portrayed."""

    name: str  # Also the folder of the results.
    source: Path  # Photo, folder of photos, video or calibrated data set.
    # styles, displays: Names of those that are wanted.
    styles: tuple[str, ...]
    displays: tuple[str, ...]
    # pages, sweeps: Whether each portrait gets a page, and a video.
    pages: bool
    sweeps: bool
    seed: int  # Of all random choices.
    parameters: dict[str, Any]  # What differs from the defaults, by section.


@dataclass(frozen=True)
class Style:
    """A painting, as a path or the name of one that is built in, and its parameters."""

    name: str
    painting: str
    parameters: dict[str, Any]


@dataclass(frozen=True)
class Panel:
    """A display that is coded for, and its parameters."""

    name: str
    display: Display
    parameters: dict[str, Any]


@dataclass(frozen=True)
class Jobs:
    """The contents of a jobs file."""

    path: Path  # The file, for messages.
    # sitters, styles, panels: In the order of the file, by name.
    sitters: dict[str, Sitter]
    styles: dict[str, Style]
    panels: dict[str, Panel]
    config: MakeConfig  # The parameters without overrides.

    def parameters(self, sitter: str, style: str = "", panel: str = "") -> MakeConfig:
        """The parameters of a sitter's stages, in a style and for a display where they count."""
        config = self.config
        if style:
            config = overlaid(config, self.styles[style].parameters, f"{self.path}: {style}")
        if panel:
            config = overlaid(config, self.panels[panel].parameters, f"{self.path}: {panel}")
        return overlaid(config, self.sitters[sitter].parameters, f"{self.path}: {sitter}")


def load_jobs(path: Path) -> Jobs:
    """Read a file of jobs."""
    try:
        data = tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"can't read the jobs {path}: {error}") from error
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise UserError(f"{path} is not valid TOML: {error}") from error
    known = ("defaults", "sitter", "style", "display")
    for key in data:
        if key not in known:
            raise unknown_key(str(path), key, known)
    return _Reader(path, data).jobs()


def _folded(name: str) -> str:
    """What some systems make of a folder's name: equal for names that are one folder there.

    Capitals, ways to write an accent, and dots and spaces at the end do not count.
    """
    plain = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())
    return plain.rstrip(". ")


class _Reader:
    """One file being read."""

    def __init__(self, path: Path, data: dict[str, Any]) -> None:
        self.path, self.data = path, data

    def jobs(self) -> Jobs:
        defaults = self.data.get("defaults", {})
        where = f"{self.path}: [defaults]"
        if not isinstance(defaults, dict):
            raise UserError(f"{self.path}: defaults is not a table")
        self._known(defaults, (_FROM, *_SECTIONS, *_SWITCHES), where)
        config = overlaid(MakeConfig(), self._sections(defaults), where)
        styles = self._named(self._style(*entry) for entry in self._entries("style"))
        panels = self._named(self._panel(*entry) for entry in self._entries("display"))
        switches = self._switches(defaults, where)
        if not (panels or switches.get("pages", True) or switches.get("sweeps", False)):
            raise UserError(f"{self.path}: no output is requested; add a [[display]], or set pages "
                            "or sweeps to true")
        sitters = self._named(sitter for entry in self._entries("sitter")
                              for sitter in self._sitters(*entry, styles, panels, switches))
        # Each table is applied to the defaults once, so that errors are reported now.
        for kind, things in (("style", styles), ("display", panels), ("sitter", sitters)):
            for name, thing in things.items():
                overlaid(config, thing.parameters, f"{self.path}: {kind} {name}")
        return Jobs(self.path, sitters, styles, panels, config)

    def _entries(self, kind: str) -> Iterator[tuple[dict[str, Any], str]]:
        """The tables ``[[kind]]`` and where they stand."""
        tables = self.data.get(kind, [])
        if not isinstance(tables, list) or not all(isinstance(one, dict) for one in tables):
            raise UserError(f"{self.path}: write one [[{kind}]], in double brackets, for each")
        if not tables and kind != "display":
            raise UserError(f"{self.path}: there is no [[{kind}]]; name at least one")
        for number, table in enumerate(tables, 1):
            name = table.get("name", "")
            yield table, f"{self.path}: {kind} {number}" + (f" ({name})" if name else "")

    def _known(self, table: dict[str, Any], names: Iterable[str], where: str) -> None:
        for key in table:
            if key not in (known := tuple(names)):
                raise unknown_key(where, key, known)

    def _sections(self, table: dict[str, Any]) -> dict[str, Any]:
        given = {"made_from": table[_FROM]} if _FROM in table else {}
        return {key: value for key, value in table.items() if key in _SECTIONS} | given

    def _switches(self, table: dict[str, Any], where: str) -> dict[str, Any]:
        return {key: checked(table[key], kind, f"{where}: {key}")
                for key, kind in _SWITCHES.items() if key in table}

    def _text(self, table: dict[str, Any], key: str, where: str) -> str:
        if key not in table:
            raise UserError(f"{where} lacks {key}")
        return str(checked(table[key], str, f"{where}: {key}"))

    def _here(self, name: str) -> Path:
        """A path of the file, which is relative to where the file lies.

        It may be no path at all; unlike pathlib, `os.path` takes unknown users and endless names.
        """
        return (self.path.parent / os.path.expanduser(name)).absolute()

    def _style(self, table: dict[str, Any], where: str) -> Style:
        self._known(table, ("name", "painting", *_STYLE_SECTIONS), where)
        painting = self._text(table, "painting", where)
        if os.path.isfile(self._here(painting)):
            painting = str(self._here(painting))
        name = table.get("name", Path(painting).stem)
        return Style(self._name(name, where), painting, self._sections(table))

    def _panel(self, table: dict[str, Any], where: str) -> Panel:
        self._known(table, ("name", "panel", "encode"), where)
        panel = self._text(table, "panel", where)
        file = self._here(panel)
        try:
            display = Display.resolve(file if os.path.isfile(file) else panel)
        except UserError as error:
            raise UserError(f"{where}: panel: {error}") from error
        return Panel(self._name(table.get("name", Path(panel).stem), where), display,
                     self._sections(table))

    def _sitters(self, table: dict[str, Any], where: str, styles: dict[str, Style],
                 panels: dict[str, Panel], switches: dict[str, Any]) -> Iterator[Sitter]:
        self._known(table, ("name", *_SOURCES, _FROM, "styles", "displays", *_SWITCHES, *_SECTIONS),
                    where)
        given = [key for key in _SOURCES if key in table]
        if len(given) != 1:
            raise UserError(f"{where} takes one of photos, video and capture, not "
                            f"{' and '.join(given) or 'none'}")
        source = self._text(table, given[0], where)
        own: dict[str, Any] = {"pages": True, "sweeps": False, "seed": 0, **switches,
               **self._switches(table, where)}
        own |= {key: self._choice(table, key, known, where)
                for key, known in (("styles", styles), ("displays", panels))}
        several = glob.has_magic(source) and not os.path.exists(self._here(source))
        if several and "name" in table:
            raise UserError(f"{where}: sitters of a pattern are named after their folders; leave "
                            "out name")
        found = self._matches(source, where) if several else [self._here(source)]
        for path in found:
            if not os.path.exists(path):
                raise UserError(f"{where}: {given[0]}: there is no folder or file {path}")
            name = self._name(table.get("name", path.stem if path.is_file() else path.name), where)
            yield Sitter(name=name, source=path, parameters=self._sections(table), **own)

    def _matches(self, pattern: str, where: str) -> list[Path]:
        """The folders and videos that a pattern names, or else the photos."""
        paths = [path for path in sorted(map(Path, glob.glob(str(self._here(pattern)))),
                                         key=natural_key) if not is_junk(path)]
        found = ([path for path in paths if path.is_dir() or is_video(path)]
                 or [path for path in paths if kind_of(path) == "picture"])
        if not found:
            raise UserError(f"{where}: no folder, video or photo matches {pattern}")
        return found

    def _choice(self, table: dict[str, Any], key: str, known: dict[str, Any], where: str,
                ) -> tuple[str, ...]:
        """Names of styles or displays, all of them by default."""
        if key not in table:
            return tuple(known)
        names: tuple[str, ...] = checked(table[key], tuple[str, ...], f"{where}: {key}")
        for name in names:
            if name not in known:
                raise unknown_key(f"{where}: {key}", name, known)
        return names

    def _name(self, name: Any, where: str) -> str:
        """A name that is a folder's, too."""
        text = str(checked(name, str, f"{where}: name"))
        if not text.strip(". ") or text[0] == "." or any(sign in text for sign in '/\\:*?"<>|\0'):
            raise UserError(f"{where}: name = {text!r} can't be a folder's name")
        if _folded(text) in TAKEN or _folded(text).startswith("quilt_"):
            raise UserError(f"{where}: name = {text!r} is taken by the batch's own files")
        return text

    def _named(self, things: Iterable[Any]) -> dict[str, Any]:
        """Things by their names, each of which is there once."""
        found: dict[str, Any] = {}
        taken: dict[str, str] = {}
        for thing in things:
            other = taken.setdefault(_folded(thing.name), thing.name)
            if thing.name in found:
                raise UserError(f"{self.path}: the name {thing.name} is used twice; choose "
                                "different names")
            if other != thing.name:
                raise UserError(f"{self.path}: the names {other!r} and {thing.name!r} are one "
                                "folder on some systems; choose different names")
            found[thing.name] = thing
        return found
