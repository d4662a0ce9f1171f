"""Tables of how well people are kept: against limits, and before and after a change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

__all__ = ["LIMITS", "beyond", "counts", "people_table", "people_table_compared"]

LIMITS: dict[str, float] = {"landmarks": 0.04, "arc": 0.04, "lost": 0.0, "gaze": 5.0, "lids": 0.15,
                            "forehead": 0.01, "seam": 9.0, "mouth": 0.55}
"""Largest figure, by kind, that does not count as a defect. Landmarks, gaze and forehead are what
was asked for; the others lie between what looks right and what does not, in the pictures that were
looked at."""
_HOW = {"landmarks": ".3f", "arc": ".3f", "lost": ".2f", "gaze": ".1f", "lids": ".2f",
        "forehead": ".3f", "seam": ".1f", "mouth": ".2f"}

Figures = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""By sitter, by style: those of `people_found`."""


def beyond(kind: str, figures: Mapping[str, Any]) -> bool:
    """Whether a figure is beyond its limit; what could not be measured is not.

    A seam no stronger than the painter's own edges in his face is within.
    """
    value, limit = figures.get(kind), LIMITS[kind]
    if kind == "seam":
        limit = max(limit, figures.get("seam_painting") or 0.0)
    return value is not None and bool(value > limit)


def counts(rows: Figures) -> dict[str, tuple[int, int]]:
    """By kind: pairs beyond the limit, and pairs that were measured."""
    pairs = [figures for styles in rows.values() for figures in styles.values()]
    return {kind: (sum(beyond(kind, one) for one in pairs),
                   sum(_known(one.get(kind)) for one in pairs)) for kind in LIMITS}


def _known(value: Any) -> bool:
    return value is not None and not np.isnan(value)


def _cell(kind: str, figures: Mapping[str, Any]) -> str:
    value = figures.get(kind)
    if not _known(value):
        return "- "
    return format(value, _HOW[kind]) + ("*" if beyond(kind, figures) else " ")


def _heading() -> str:
    return f"{'sitter':<12}{'style':<27}" + "".join(f"{kind:>11}" for kind in LIMITS)


def _limits() -> str:
    return f"{'limit':<39}" + "".join(f"{format(limit, _HOW[kind]) + ' ':>11}"
                                      for kind, limit in LIMITS.items())


def people_table(rows: Figures) -> str:
    """A line for each pair, figures beyond their limit with a star; then counts by kind."""
    lines = [_heading()]
    for sitter, styles in rows.items():
        lines += [f"{sitter[:11]:<12}{style[:26]:<27}" + "".join(
            f"{_cell(kind, figures):>11}" for kind in LIMITS) for style, figures in styles.items()]
    number = counts(rows)
    total, measured = (sum(column) for column in zip(*number.values()))
    lines += [_limits(), f"{'beyond the limit':<39}" + "".join(
        f"{f'{one} of {of}':>11}" for one, of in number.values())]
    lines.append(f"together: {total} of {measured}")
    return "\n".join(lines)


def people_table_compared(before: Figures, after: Figures) -> str:
    """The pairs of both, a line for each figure that was or is beyond its limit; then counts."""
    both = {sitter: {style: figures for style, figures in styles.items()
                     if style in before.get(sitter, {})} for sitter, styles in after.items()}
    old = {sitter: {style: before[sitter][style] for style in styles}
           for sitter, styles in both.items()}
    lines = [f"{'sitter':<12}{'style':<27}{'kind':<11}{'before':>11}{'after':>11}"]
    for sitter, styles in both.items():
        for style, now in styles.items():
            then = old[sitter][style]
            lines += [f"{sitter[:11]:<12}{style[:26]:<27}{kind:<11}{_cell(kind, then):>11}"
                      f"{_cell(kind, now):>11}" for kind in LIMITS
                      if beyond(kind, then) or beyond(kind, now)]
    lines.append(f"{'beyond the limit':<39}" + "".join(f"{kind:>11}" for kind in LIMITS))
    for title, rows in (("before", old), ("after", both)):
        lines.append(f"{title:<39}" + "".join(f"{f'{one} of {of}':>11}"
                                              for one, of in counts(rows).values()))
    return "\n".join(lines)
