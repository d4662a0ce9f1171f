"""Apply tables of a TOML file to parameter classes.

A table's entries take the place of the fields of the same names, tables in it those of the nested
data classes. Unknown names and wrong types are reported on one line, with the place in the file.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import types
import typing
from collections.abc import Mapping
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

from ...errors import UserError
from ...plugins import Choice
from ...stylize import StylizeConfig

__all__ = ["checked", "overlaid", "unknown_key"]

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

    Parameters
    ----------
    value
        As `tomllib` read it.
    kind
        ``int``, ``float``, ``str``, ``bool``, a ``Literal``, a tuple of these, or one or None.
    where
        File and entry, for the message.

    Raises
    ------
    UserError
        If the value is of another type.
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


@functools.cache
def _types(kind: Any) -> dict[str, Any]:
    """The types of a data class's fields."""
    return typing.get_type_hints(kind, include_extras=True)


def overlaid(config: _Config, table: Mapping[str, Any], where: str) -> _Config:
    """A data class of parameters with a table's entries in place of its own.

    Parameters
    ----------
    config
        The parameters.
    table
        Entries by the fields' names; fields that are data classes have tables of their own.
    where
        File and table, for messages.

    Raises
    ------
    UserError
        If an entry is unknown or of the wrong type.
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
