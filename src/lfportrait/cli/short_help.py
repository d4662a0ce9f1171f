"""Short help: ``--help`` shows the common options, ``--help-all`` all of them.

tyro lists each option of a command's configurations, of which `make` has some two hundred. What is
shown at first are the command's own options and those that it calls `usual`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import re
from collections.abc import Iterator
from typing import Any

__all__ = ["print_short_help"]

_MOST = 16
"""A command with no more options than this shows all of them."""
_OPTION = re.compile(r"^│ (?:-\w, )?--[\w.-]+")
_NAME = re.compile(r"--([\w.-]+)")


def _help(command: type, program: str) -> str:
    """Tyro's help of a class."""
    import tyro

    # With an encoding: tyro draws its boxes of letters that the output can show.
    text = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
        tyro.cli(command, args=["--help"], prog=program)
    text.seek(0)
    return text.read()


def print_short_help(command: type, program: str) -> None:
    """Print a command's help without the options that few people need."""
    print(_short(_help(command, program), _usual(command), program), end="")


def _usual(command: Any) -> set[str]:
    """Names of a command's own options, and of those that it names."""
    above = {field.name for base in command.__mro__[1:] if dataclasses.is_dataclass(base)
             for field in dataclasses.fields(base)}
    own = {field.name for field in dataclasses.fields(command)} - above
    return {name.replace("_", "-") for name in ("help", "quiet", *own, *command.usual)}


def _short(text: str, usual: set[str], program: str) -> str:
    """The text without the other options; whole where there are few."""
    if len([line for line in text.splitlines() if _OPTION.match(line)]) <= _MOST:
        return text
    kept: list[str] = []
    hidden = 0
    for box in _boxes(text.splitlines()):
        if not box[0].startswith("╭") or "positional" in box[0]:
            kept += box
            continue
        lines, left_out = _chosen(box, usual)
        hidden += left_out
        kept += lines
    return "\n".join([*kept, *([f"More options: {program} --help-all", ""] if hidden else [""])])


def _boxes(lines: list[str]) -> Iterator[list[str]]:
    """The lines of each box, and single lines between boxes."""
    box: list[str] = []
    for line in lines:
        box.append(line)
        if not box[0].startswith("╭") or line.startswith("╰"):
            yield box
            box = []


def _chosen(box: list[str], usual: set[str]) -> tuple[list[str], int]:
    """The lines of a box's usual options with its frame, or none; and how many were left out."""
    lines, left_out, inside = [], 0, False
    for line in box[1:-1]:
        if _OPTION.match(line):
            inside = bool(usual & {*_NAME.findall(line)})
            left_out += not inside
        if inside:
            lines.append(line)
    return ([box[0], *lines, box[-1]] if lines else []), left_out
