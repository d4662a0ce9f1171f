"""The results of a study as files: tables to read, to compute with, and drawings."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from lfportrait.files import atomic_write, write_json

from ..markdown import interval, number, percent, table
from .analysis import analyse, read_answers

_COLUMNS = {
    "preferences.csv": ("question", "first", "second", "count", "total", "share", "low", "high",
                        "effective", "wilson_low", "wilson_high", "people_for", "people_against",
                        "people_undecided", "p", "p_holm"),
    "ranking.csv": ("question", "method", "strength", "low", "high", "expected_share", "wins",
                    "answers"),
}


def _p(value: float) -> str:
    return "< 0.0001" if value < 1e-4 else f"{value:.4f}"


def _preferences(figures: dict[str, Any]) -> str:
    return table(
        ("question", "preferred", "to", "share", "95 % interval", "answers", "people for : against",
         "p", "p (Holm)"),
        [(row["question"], row["first"], row["second"], percent(row["share"]), interval(row),
          str(row["total"]), f"{row['people_for']} : {row['people_against']}", _p(row["p"]),
          _p(row["p_holm"])) for row in figures["preferences"]])


def _ranking(figures: dict[str, Any]) -> str:
    rows = [row for ranking in figures["ranking"].values() for row in ranking or ()]
    missing = [name for name, ranking in figures["ranking"].items() if ranking is None]
    text = table(("question", "method", "strength", "95 % interval", "wins expected"),
                  [(row["question"], row["method"], f"{row['strength']:+.2f}",
                    f"{row['low']:+.2f} to {row['high']:+.2f}", percent(row["expected_share"]))
                   for row in rows]) if rows else ""
    if missing:
        text += ("\n\nNo ranking: some methods were never compared, not even indirectly.")
    return text.strip()


def _people(figures: dict[str, Any]) -> str:
    rows = []
    for agreement, oneself, left in zip(figures["agreement"], figures["self_agreement"],
                                        figures["left"]):
        rows.append((agreement["question"], number(agreement["kendall_u"]),
                     number(agreement["fleiss_kappa"]), number(agreement["krippendorff_alpha"]),
                     f"{percent(oneself['share'])} of {oneself['total']}",
                     f"{percent(left['share'])} ({interval(left)})"))
    return table(("question", "Kendall's u", "Fleiss' kappa", "Krippendorff's alpha",
                   "same choice again", "left chosen"), rows)


def _markdown(figures: dict[str, Any]) -> str:
    asked = "\n".join(f"- **{question['name']}**: {question['text']}"
                      for question in figures["questions"])
    left_out = "\n".join(f"- {entry['file']}: {entry['reason']}" for entry in figures["left_out"])
    seconds = figures["seconds_per_answer"]
    count = figures["people"]
    return "\n\n".join([
        "# Results of a user study",
        f"{count} {'person' if count == 1 else 'people'}, {figures['answers']} answers"
        + ("" if seconds is None else f", {seconds:g} s for one (median)")
        + f". Study `{figures['study']}`.",
        asked,
        "## Preferences", "![Shares with their intervals](preferences.svg)",
        _preferences(figures),
        "Intervals are Wilson's, for the effective number of answers: those of one person are "
        "correlated. The p-values are those of the sign test over people: each counts once, for "
        "the method that they chose more often. Holm's correction is for all rows together.",
        "## Ranking",
        *(["![Strengths with their intervals](ranking.svg)"]
          if any(figures["ranking"].values()) else []),
        _ranking(figures),
        "Strengths are logarithms after Bradley and Terry, 0 on average: one that is higher by 1 "
        "wins 73 % of the time. Their intervals come from 2000 bootstrap samples of people.",
        "## People", _people(figures),
        "Agreement is 1 if all people agree and 0 at chance level. *Same choice "
        "again*: for pairs shown twice, with swapped sides.",
        *(["## Files that were left out", left_out] if left_out else [])]) + "\n"


def _chart_files(figures: dict[str, Any]) -> dict[str, str]:
    def group(rows: Sequence[dict[str, Any]]) -> list[Row]:
        return [Row(f"{row['first']} over {row['second']}", 100 * row["share"], 100 * row["low"],
                    100 * row["high"], f"{percent(row['share'])} of {row['total']}")
                for row in rows]

    names = [question["name"] for question in figures["questions"]]
    found = {"preferences.svg": interval_chart(
        [(name, group([row for row in figures["preferences"] if row["question"] == name]))
         for name in names], title="Which portrait people preferred",
        across="share of answers in %, 95 % intervals", reference=50.0,
        span=(0.0, 100.0))}
    ranked = [(name, [Row(row["method"], row["strength"], row["low"], row["high"],
                          f"{row['strength']:+.2f}") for row in figures["ranking"][name]])
              for name in names if figures["ranking"][name]]
    if ranked:
        found["ranking.svg"] = interval_chart(
            ranked, title="Ranking of the methods",
            across="strength (logarithm, Bradley and Terry), 95 % intervals over people",
            reference=0.0)
    return found


def _csv(rows: Sequence[dict[str, Any]], columns: Sequence[str]) -> str:
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


def write_results(files: Sequence[str | Path], out: str | Path, *, study: Path | None = None,
                  seed: int = 0) -> dict[str, Any]:
    """Evaluate the answers to a study; figures of `analyse`, and ``left_out``, as `read_answers`.

    ``out`` is a folder for ``results.md``, ``results.json``, ``preferences.csv``, ``ranking.csv``,
    ``preferences.svg`` and ``ranking.svg``.
    """
    people, left_out = read_answers([Path(file) for file in files], study)
    figures = analyse(people, seed)
    figures["left_out"] = [{"file": str(file), "reason": reason} for file, reason in left_out]
    rows = {"preferences.csv": figures["preferences"],
            "ranking.csv": [row for ranking in figures["ranking"].values()
                            for row in ranking or ()]}
    texts = {**_chart_files(figures), "results.md": _markdown(figures),
             **{name: _csv(rows[name], columns) for name, columns in _COLUMNS.items()}}
    for name, text in texts.items():
        with atomic_write(Path(out) / name) as stream:
            stream.write(text.encode())
    write_json(Path(out) / "results.json", figures)
    return figures


_INK, _SOFT, _GRID = "#28282c", "#6f6f76", "#e2e2e6"
_COLORS = ("#1f62b4", "#c85214", "#28824a", "#823c96")
_WIDTH, _ROW, _LETTER = 860, 26, 7.2


@dataclass(frozen=True)
class Row:
    """A dot, the ends of the line through it, and the words to its left and right."""

    label: str
    value: float
    low: float
    high: float
    note: str = ""


def _ticks(low: float, high: float) -> list[float]:
    """About eight round numbers from ``low`` to ``high``."""
    raw = max(high - low, 1e-9) / 8
    unit = 10.0 ** math.floor(math.log10(raw))
    step = next(unit * size for size in (1, 2, 2.5, 5, 10) if unit * size >= raw * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [step * k for k in range(first, last + 1)]


def _text(x: float, y: float, text: str, anchor: str = "start", color: str = _INK,
          weight: str = "normal") -> str:
    return (f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{color}" '
            f'font-weight="{weight}">{escape(text)}</text>')


def interval_chart(groups: Sequence[tuple[str, Sequence[Row]]], *, title: str, across: str,
                   reference: float, span: tuple[float, float] | None = None) -> str:
    """Draw groups of values, a heading and rows each, with their intervals, as SVG text.

    ``across`` says what the axis shows, from end to end of ``span`` (by default what the intervals
    need); a line marks no difference at ``reference``.
    """
    rows = [row for _, members in groups for row in members]
    if span is None:
        low = min(reference, *(row.low for row in rows))
        high = max(reference, *(row.high for row in rows))
        low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
    else:
        low, high = span
    left = 24 + _LETTER * max(len(row.label) for row in rows)
    right = _WIDTH - 40 - _LETTER * max(len(row.note) for row in rows)
    bottom = 56 + _ROW * (len(rows) + sum(1.5 if name else 0.5 for name, _ in groups))

    def place(value: float) -> float:
        return left + (right - left) * (value - low) / max(high - low, 1e-9)

    parts = [f'<rect width="{_WIDTH}" height="{bottom + 56:.0f}" fill="#fff"/>',
             _text(16, 28, title, weight="bold")]
    for tick in _ticks(low, high):
        parts += [f'<path d="M{place(tick):.1f} 44V{bottom:.1f}" stroke="{_GRID}"/>',
                  _text(place(tick), bottom + 18, f"{tick:g}", "middle", _SOFT)]
    parts.append(f'<path d="M{place(reference):.1f} 44V{bottom:.1f}" stroke="{_SOFT}" '
                 'stroke-dasharray="4 3"/>')
    y = 56.0
    for group, (name, members) in enumerate(groups):
        color = _COLORS[group % len(_COLORS)]
        if name:
            y += _ROW
            parts.append(_text(16, y - 6, name, color=color, weight="bold"))
        for row in members:
            y += _ROW
            middle = y - 10
            parts += [_text(left - 10, y - 5, row.label, "end"),
                      f'<path d="M{place(row.low):.1f} {middle}H{place(row.high):.1f}" '
                      f'stroke="{color}" stroke-width="3" stroke-linecap="round"/>',
                      f'<circle cx="{place(row.value):.1f}" cy="{middle}" r="5.5" '
                      f'fill="{color}"/>',
                      _text(_WIDTH - 16, y - 5, row.note, "end", _SOFT)]
        y += _ROW / 2
    parts.append(_text((left + right) / 2, bottom + 40, across, "middle", _SOFT))
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {bottom + 56:.0f}" '
            f'width="{_WIDTH}" font-family="system-ui, sans-serif" font-size="13" role="img">\n'
            f"<title>{escape(title)}</title>\n" + "\n".join(parts) + "\n</svg>\n")
