"""The commands ``doctor`` (installation check) and ``models`` (pretrained networks)."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from ..errors import UserError
from ..health import Fact, examine
from .common import Common

__all__ = ["Doctor", "Models", "ModelsAdd", "ModelsFetch"]

_MARKS = {"good": ("✓", "+", "32"), "optional": ("·", "-", "33"), "bad": ("✗", "!", "31;1")}
"""Mark of each state, the same in ASCII, and its color in a terminal."""


@dataclass
class Doctor(Common):
    """Check the installation and suggest fixes."""

    def run(self) -> dict[str, Any]:
        """Look and print."""
        facts = examine()
        bad = sum(fact.state == "bad" for fact in facts)
        if not self.quiet:
            print("\n".join(_lines(facts, _colored(), _unicode())))
            print("\n" + ("No problems found." if not bad else
                          f"{bad} {'problems' if bad > 1 else 'problem'} found."))
        return {"facts": [fact._asdict() for fact in facts], "problems": bad}


@dataclass
class Models(Common):
    """List the pretrained networks: which are there, what each is for.

    `lfportrait models fetch` downloads some, `lfportrait models add` takes files.
    """

    def run(self) -> dict[str, Any]:
        """Print a line for each."""
        from .. import models

        print("\n".join(models.listing()))
        return _at_hand()


@dataclass
class ModelsFetch(Common):
    """Download pretrained networks."""

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Networks or groups; by default portrait, those of the main job."""

    def run(self) -> dict[str, Any]:
        """Download those that are missing."""
        from .. import models

        for name in models.expand(self.names or ("portrait",)):
            print(f"{name}: {models.fetch(name, quiet=self.quiet)}")
        return _at_hand()


@dataclass
class ModelsAdd(Common):
    """Take files of pretrained networks that you downloaded yourself."""

    files: tyro.conf.Positional[tuple[Path, ...]]
    """The files."""

    def run(self) -> dict[str, Any]:
        """Check and copy each."""
        from .. import models

        if not self.files:
            raise UserError("name the file to add: lfportrait models add FILE")
        for file in self.files:
            print(f"{file}: {models.add(file)}")
        return _at_hand()


def _at_hand() -> dict[str, Any]:
    from .. import models

    return {"models": {name: models.available(name) for name in models.registry()}}


def _colored() -> bool:
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ


def _unicode() -> bool:
    return (sys.stdout.encoding or "").lower().replace("-", "") == "utf8"


def _lines(facts: list[Fact], colored: bool, unicode: bool) -> list[str]:
    """One line a fact, under the headings of their groups."""
    def dyed(text: str, code: str) -> str:
        return f"\033[{code}m{text}\033[0m" if colored else text

    width = max(len(fact.name) for fact in facts)
    lines: list[str] = []
    for group in dict.fromkeys(fact.group for fact in facts):
        lines += ([""] if lines else []) + [dyed(group, "1")]
        members = [fact for fact in facts if fact.group == group]
        text_width = max((len(fact.text) for fact in members if fact.remedy), default=0)
        for fact in members:
            mark, plain, code = _MARKS[fact.state]
            remedy = f"{fact.text:<{text_width}}  {dyed(fact.remedy, '36')}"
            lines.append(f"  {dyed(mark if unicode else plain, code)} {fact.name:<{width}}  "
                         f"{remedy if fact.remedy else fact.text}")
    return lines
