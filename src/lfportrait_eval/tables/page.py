"""The comparison page: all methods' pictures, tables and plots in one file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lfportrait.share import Picture, Report, Section, Table, write_report

from ..study import Row, interval_chart
from .summary import COLUMNS, FLOORS, Cell, Spread

__all__ = ["write_tables_page"]

Rows = dict[str, dict[str, Spread]]
Grid = tuple[str, list[str], list[list[str]], list[Any]]

_PLOTS = ("short_normalised", "long_normalised", "patches", "sharpness", "identity_error",
          "contours", "content", "seconds_once")
"""Figures that are drawn."""


def _chart(name: str, rows: Rows, base: Rows) -> str | None:
    """Means of all methods with their spread."""
    column = COLUMNS[name]
    drawn = []
    for method, row in {**rows, **base}.items():
        spread = row.get(name)
        if spread is not None:
            drawn.append(Row(FLOORS.get(method, method), spread.mean,
                             spread.mean - spread.deviation, spread.mean + spread.deviation,
                             f"{spread.mean:.{column.digits}f}"))
    if not drawn:
        return None
    floor = base.get("field", {}).get(name)
    reference = 1.0 if column.better == "one" else floor.mean if floor else drawn[0].value
    words = {"low": "lower is better", "high": "higher is better", "one": "1 is best", "": ""}
    return interval_chart([("", drawn)], title=column.title, across=words[column.better],
                          reference=reference)


def write_tables_page(out: Path, facts: dict[str, Any], cells: Sequence[Cell], rows: Rows,
                      base: Rows, tables: Sequence[Grid], notes: Sequence[str],
                      paintings: dict[str, NDArray[np.uint8]]) -> None:
    """Write ``index.html``.

    Parameters
    ----------
    out
        Folder of the run, with its pictures.
    facts, cells, rows, base, tables, notes
        What was measured.
    paintings
        The styles' pictures by name.
    """
    sections = [Section("What is compared", "\n\n".join(
        f"{name}: {what}" for name, what in facts["methods"].items()))]
    sections += [Section(title, tables=[Table([[
        f"{cell} (best)" if 0 < column <= len(winners) and winners[column - 1] == line[0]
        else cell for column, cell in enumerate(line)] for line in lines], head)])
        for title, head, lines, winners in tables]
    drawings = [chart for name in _PLOTS if (chart := _chart(name, rows, base)) is not None]
    sections.append(Section(
        "Plots", "Mean and standard deviation over sitters and styles. The dashed line is the "
        "field before style where it has the figure, 1 where 1 is best, else the first method.",
        drawings=drawings))
    if notes:
        sections.append(Section("Not measured, and with which networks", "\n\n".join(notes)))
    for sitter in facts["sitters"]:
        for style in facts["styles"]:
            mine = [cell for cell in cells if (cell.sitter, cell.style) == (sitter, style)]
            if mine:
                sections.append(_pictures(out, sitter, style, mine, paintings[style]))
    sizes = facts["sizes"]
    write_report(out / "index.html", Report(
        "Methods side by side",
        f"Sitters: {', '.join(facts['sitters'])}; styles: {', '.join(facts['styles'])}; seed "
        f"{facts['seed']}; "
        f"{facts['size']}: views of {sizes.render_size} and {sizes.close_size} pixels; lfportrait "
        f"{facts['version']}", sections=sections))


def _pictures(out: Path, sitter: str, style: str, cells: Sequence[Cell],
              painting: NDArray[np.uint8]) -> Section:
    """All methods for one sitter in one style, at -45, 0 and 45 degrees."""
    folder = out / "pictures" / sitter
    pictures = [Picture(_on_strip(painting), f"{style}, the painting", width=768),
                Picture(folder / "photo.png", "the field before style", width=768)]
    pictures += [Picture(folder / style / f"{cell.method}.png", cell.method, width=768)
                 for cell in cells]
    return Section(f"{sitter} in the manner of {style}",
                   "At -45, 0 and 45 degrees.", pictures, layout="grid")


def _on_strip(painting: NDArray[np.uint8], height: int = 256) -> NDArray[np.uint8]:
    """A painting in the middle of a white strip, three times as wide as high like all others."""
    picture = Image.fromarray(painting)
    picture.thumbnail((3 * height, height), Image.Resampling.LANCZOS)
    strip = Image.new("RGB", (3 * height, height), "white")
    strip.paste(picture, ((strip.width - picture.width) // 2, 0))
    return np.asarray(strip)
