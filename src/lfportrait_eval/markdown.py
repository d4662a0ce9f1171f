"""Tables in Markdown, and numbers that may be unknown as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    return "\n".join([line(head), line(["---"] * len(head)), *map(line, rows)])


def number(value: float | None, digits: int = 2) -> str:
    """A number with so many digits behind the point; a dash where it is unknown."""
    return "-" if value is None else f"{value:.{digits}f}"


def percent(value: float | None) -> str:
    """A share as text."""
    return "-" if value is None else f"{100 * value:.1f} %"


def interval(row: dict[str, Any]) -> str:
    """A share's interval from ``low`` to ``high``, as text."""
    return "-" if row["low"] is None else f"{100 * row['low']:.1f} to {100 * row['high']:.1f} %"
