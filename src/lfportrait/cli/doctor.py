"""Commands of upkeep: ``doctor`` (what works on this machine, one line a fact), ``models``."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro

from ..errors import UserError
from ..health import Fact, examine
from .common import Common

__all__ = ["Doctor", "Models"]

_MARKS = {"good": ("✓", "+", "32"), "optional": ("·", "-", "33"), "bad": ("✗", "!", "31;1")}
"""Mark of each state, the same in ASCII, and its colour in a terminal."""


@dataclass
class Doctor(Common):
    """Tell what works on this machine, and the commands that mend what does not."""

    def run(self) -> dict[str, Any]:
        """Look and print."""
        facts = examine()
        bad = sum(fact.state == "bad" for fact in facts)
        if not self.quiet:
            print("\n".join(_lines(facts, _coloured(), _unicode())))
            print("\n" + ("All is well." if not bad else
                          f"{bad} {'things need' if bad > 1 else 'thing needs'} mending."))
        return {"facts": [fact._asdict() for fact in facts], "problems": bad}


@dataclass
class Models(Common):
    """List, fetch and add the pretrained networks."""

    action: tyro.conf.Positional[Literal["list", "fetch", "add"]] = "list"
    """What to do."""
    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Networks or groups to fetch (portrait by default, those of the main job), or files to add."""

    def run(self) -> dict[str, Any]:
        """Do what ``action`` says."""
        from .. import models

        if self.action == "list":
            print("\n".join(models.listing()))
        elif self.action == "fetch":
            for name in models.expand(self.names or ("portrait",)):
                print(f"{name}: {models.fetch(name, quiet=self.quiet)}")
        else:
            if not self.names:
                raise UserError("name the file to add: lfportrait models add FILE")
            for name in self.names:
                print(f"{name}: {models.add(Path(name))}")
        return {"models": {name: models.available(name) for name in models.registry()}}


def _coloured() -> bool:
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ


def _unicode() -> bool:
    return (sys.stdout.encoding or "").lower().replace("-", "") == "utf8"


def _lines(facts: list[Fact], coloured: bool, unicode: bool) -> list[str]:
    """One line a fact, under the headings of their groups."""
    def dyed(text: str, code: str) -> str:
        return f"\033[{code}m{text}\033[0m" if coloured else text

    width = max(len(fact.name) for fact in facts)
    lines: list[str] = []
    for group in dict.fromkeys(fact.group for fact in facts):
        lines += ([""] if lines else []) + [dyed(group, "1")]
        members = [fact for fact in facts if fact.group == group]
        text_width = max((len(fact.text) for fact in members if fact.mend), default=0)
        for fact in members:
            mark, plain, code = _MARKS[fact.state]
            mend = f"{fact.text:<{text_width}}  {dyed(fact.mend, '36')}"
            lines.append(f"  {dyed(mark if unicode else plain, code)} {fact.name:<{width}}  "
                         f"{mend if fact.mend else fact.text}")
    return lines
