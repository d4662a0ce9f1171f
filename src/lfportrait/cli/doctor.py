"""The command ``doctor``: what works on this machine, one line a fact."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from typing import Any

from ..health import Fact, examine
from .common import Common

__all__ = ["Doctor"]

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
