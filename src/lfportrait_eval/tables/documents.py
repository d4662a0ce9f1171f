"""The tables as files: Markdown to read and to include, CSV and JSON to compute with, the page.

They show the mean, spread and number of the cells' figures over sitters and styles.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image

from lfportrait.arrays import UInt8
from lfportrait.errors import UserError
from lfportrait.files import atomic_write, write_json
from lfportrait.share import Picture, Report, Section, Table, write_report

from ..markdown import interval, number, percent, table
from ..study import Row, interval_chart
from .figures import missing_networks

FLOORS = {"field": "the field before style", "photos": "the photos"}
"""Rows of the consistency that are no methods."""


@dataclass(frozen=True)
class Column:
    """One figure."""

    name: str  # In the cells.
    title: str  # At the head of a table.
    # ``low``, ``high``, or ``one``: the nearer to 1 the better; empty: neither.
    better: Literal["low", "high", "one", ""] = "low"
    digits: int = 3  # Behind the point.


@dataclass(frozen=True)
class Cell:
    """One method's result for one sitter in one style."""

    sitter: str
    style: str
    method: str
    figures: dict[str, float | None]
    facts: dict[str, Any]


@dataclass(frozen=True)
class Spread:
    """Mean, standard deviation (of single cells, n - 1) and number; the deviation of one is 0."""

    mean: float
    deviation: float
    count: int

    @staticmethod
    def of(values: Iterable[float | None]) -> Spread | None:
        """Of what is known; None where nothing is."""
        known = np.array([value for value in values if value is not None and np.isfinite(value)],
                         np.float64)
        if not len(known):
            return None
        return Spread(float(known.mean()), float(known.std(ddof=1)) if len(known) > 1 else 0.0,
                      len(known))


COLUMNS = {column.name: column for column in (
    Column("short_rmse", "neighbours, RMSE", digits=4),
    Column("long_rmse", "7 apart, RMSE", digits=4),
    Column("ends_rmse", "ends, RMSE", digits=4),
    Column("short_normalised", "neighbours, over contrast"),
    Column("long_normalised", "7 apart, over contrast"),
    Column("short_lpips_alex", "neighbours, LPIPS alex"),
    Column("long_lpips_alex", "7 apart, LPIPS alex"),
    Column("short_lpips_vgg", "neighbours, LPIPS vgg"),
    Column("long_lpips_vgg", "7 apart, LPIPS vgg"),
    Column("contrast", "contrast", "", 2),
    Column("patches", "patches", digits=2),
    Column("sharpness", "sharpness", "one", 2),
    Column("identity_error", "landmarks"),
    Column("identity_found", "faces found", "high", 2),
    Column("contours", "contours", "high", 2),
    Column("repeats_hair", "repeats, hair", digits=2),
    Column("repeats_body", "repeats, body", digits=2),
    Column("content", "content"),
    Column("fid_64", "FID-64", digits=2),
    Column("fid_192", "FID-192", digits=2),
    Column("fid_768", "FID-768", digits=3),
    Column("fid_2048", "FID-2048", digits=1),
    Column("kid_768", "KID-768", digits=4),
    Column("psnr_content", "PSNR, photo field", "high", 2),
    Column("ssim_content", "SSIM, photo field", "high"),
    Column("lpips_alex_content", "LPIPS alex, photo field"),
    Column("lpips_vgg_content", "LPIPS vgg, photo field"),
    Column("psnr_example", "PSNR, painted views", "high", 2),
    Column("ssim_example", "SSIM, painted views", "high"),
    Column("lpips_alex_example", "LPIPS alex, painted views"),
    Column("lpips_vgg_example", "LPIPS vgg, painted views"),
    Column("seconds_once", "once, s", digits=1),
    Column("seconds_view", "each view, s"),
    Column("memory", "peak memory, GiB", digits=2),
)}
"""All figures of a cell."""

GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "overview": ("Side by side", (
        "short_normalised", "long_normalised", "contrast", "patches", "sharpness",
        "identity_error", "identity_found", "contours", "repeats_hair", "repeats_body")),
    "consistency": ("Consistency", (
        "short_rmse", "long_rmse", "ends_rmse", "short_normalised", "long_normalised",
        "short_lpips_alex", "long_lpips_alex", "short_lpips_vgg", "long_lpips_vgg", "contrast")),
    "style": ("Distance to the style and to the photo", (
        "fid_64", "fid_192", "fid_768", "fid_2048", "kid_768", "patches", "content")),
    "table_2": ("Table 2", (
        "fid_2048", "psnr_content", "ssim_content", "lpips_alex_content", "lpips_vgg_content",
        "psnr_example", "ssim_example", "lpips_alex_example", "lpips_vgg_example")),
    "cost": ("Cost", ("seconds_once", "seconds_view", "memory")),
}
"""The tables: title and figures."""


def spreads(cells: Sequence[Cell], methods: Sequence[str]) -> dict[str, dict[str, Spread]]:
    """By method and figure: mean, deviation and number over sitters and styles."""
    found: dict[str, dict[str, Spread]] = {}
    for method in methods:
        mine = [cell.figures for cell in cells if cell.method == method]
        found[method] = {name: spread for name in [*COLUMNS, "short_degrees", "long_degrees"]
                         if (spread := Spread.of(row.get(name) for row in mine)) is not None}
    return found


def best(rows: dict[str, dict[str, Spread]], name: str, methods: Sequence[str]) -> str | None:
    """The method with the best mean of a figure, over as many cells as any; None if none is."""
    column = COLUMNS[name]
    known = {method: rows[method][name] for method in methods if name in rows.get(method, {})}
    most = max((spread.count for spread in known.values()), default=0)
    full = {method: spread.mean for method, spread in known.items() if spread.count == most}
    if not column.better or len(full) < 2:
        return None
    keys = {"low": lambda value: value, "high": lambda value: -value,
            "one": lambda value: abs(value - 1.0)}
    return min(full, key=lambda method: keys[column.better](full[method]))


BEGIN, END = "<!-- tables: begin -->", "<!-- tables: end -->"
"""Lines of a Markdown file between which the tables are put."""
_MARKS = {"low": " ↓", "high": " ↑", "one": " → 1", "": ""}

Rows = dict[str, dict[str, Spread]]
Grid = tuple[str, list[str], list[list[str]], list[str | None]]
"""A table: title, head, rows, and the method that is best in each column but the first."""


def write_documents(out: Path, facts: dict[str, Any], cells: Sequence[Cell],
                    floors: dict[str, dict[str, Any]], speed: dict[str, Any],
                    study: dict[str, Any] | None, failures: Sequence[dict[str, str]],
                    paintings: dict[str, UInt8] | None) -> dict[str, Any]:
    """Write ``tables.md``, ``tables.csv``, ``tables.json`` and, with pictures, ``index.html``.

    Returns the figures of ``tables.json``.

    Parameters
    ----------
    facts : What the run was: sizes, seed, machine, sitters, styles, methods.
    cells, floors : What was measured.
    speed, study : Table 1 and Fig. 6, and the figures of a user study; empty where there are none.
    failures : Cells that could not be measured.
    paintings : The styles' pictures by name, for the page; None writes none.
    """
    missing = missing_networks()
    rows = spreads(cells, list(facts["methods"]))
    base = _floor_rows(floors)
    figures = {
        **{name: asdict(value) if name == "sizes" else value for name, value in facts.items()},
        "cells": [asdict(cell) for cell in cells], "floors": floors,
        "summary": {method: {name: asdict(spread) for name, spread in row.items()}
                    for method, row in {**rows, **base}.items()},
        "not_measured": {"cells": list(failures), "networks": missing},
        **{name: value for name, value in speed.items() if name != "stage_seconds"},
        **({"study": study} if study is not None else {})}
    grids = [*_grids(rows, base, facts), *_speed_grids(speed)]
    notes = _notes(facts, cells, failures, missing)
    text = markdown_tables(facts, base, grids, study, notes)
    for name, content in (("tables.md", text), ("tables.csv", _csv(cells, floors))):
        with atomic_write(out / name) as stream:
            stream.write(content.encode())
    write_json(out / "tables.json", figures)
    if paintings is not None:
        write_tables_page(out, facts, cells, rows, base, grids, notes, paintings)
    return figures


def _floor_rows(floors: dict[str, dict[str, Any]]) -> Rows:
    """Mean and spread over the sitters of what is no method."""
    made = [Cell(sitter, "", name, row[name], {}) for sitter, row in floors.items()
            for name in FLOORS]
    return spreads(made, list(FLOORS))


def spread_text(spread: Spread | None, digits: int) -> str:
    """Mean and spread as text; a dash where nothing was measured."""
    if spread is None:
        return "-"
    if spread.count == 1:
        return number(spread.mean, digits)
    return f"{number(spread.mean, digits)} ± {number(spread.deviation, digits)}"


def _grids(rows: Rows, base: Rows, facts: dict[str, Any]) -> list[Grid]:
    """The tables of `GROUPS`."""
    methods = list(facts["methods"])
    found: list[Grid] = []
    for key, (title, names) in GROUPS.items():
        known = [name for name in names if any(name in row for row in rows.values())]
        if not known:
            continue
        head = ["method", *(COLUMNS[name].title + _MARKS[COLUMNS[name].better] for name in known),
                "n"]
        lines = []
        extra = base if key == "consistency" else {}
        for method, row in {**{name: rows[name] for name in methods}, **extra}.items():
            counts = sorted({row[name].count for name in known if name in row})
            lines.append([FLOORS.get(method, method),
                          *(spread_text(row.get(name), COLUMNS[name].digits) for name in known),
                          " to ".join(str(count) for count in (
                              [counts[0], counts[-1]] if len(counts) > 1 else counts)) or "0"])
        found.append((title, head, lines, [best(rows, name, methods) for name in known]))
    return found


def _speed_grids(speed: dict[str, Any]) -> list[Grid]:
    """Table 1 and Fig. 6."""
    found: list[Grid] = []
    if "table_1" in speed:
        head = ["resolution", "with mask, s", "without, s", "build the mask, s", "load it, s",
                "mask, MiB", "memory while coding, MiB"]
        found.append(("Table 1: the mask guide", head, [[
            row["resolution"], *(number(row[f"{name}_seconds"], 3)
                                 for name in ("with", "without", "build", "load")),
            number(row["bytes"] / 2 ** 20, 1), number(row["memory_bytes"] / 2 ** 20, 1)]
            for row in speed["table_1"]], []))
    if "fig_6" in speed:
        head = ["transfer", "pre-calculation, s", "as published, s", "guides and synthesis, s",
                f"whole, {speed['fig_6_views']} views, s", "patches"]
        found.append(("Fig. 6: transfer by example", head, [[
            name, number(row["precalculation_seconds"], 3),
            number(row["published_seconds"], 1),
            number(row["synthesis_seconds"], 3), number(row["whole_seconds"], 1),
            number(row["patch_fidelity"], 2)] for name, row in speed["fig_6"].items()], []))
    return found


def _marked(lines: list[list[str]], winners: list[str | None], mark: str) -> list[list[str]]:
    """A table's rows with the best of each column in a mark, such as ``**{}**``."""
    return [[mark.format(cell) if 0 < column <= len(winners) and winners[column - 1] == row[0]
             else cell for column, cell in enumerate(row)] for row in lines]


def _notes(facts: dict[str, Any], cells: Sequence[Cell], failures: Sequence[dict[str, str]],
           missing: dict[str, list[str]]) -> list[str]:
    """What was not measured, and which networks the methods had."""
    titles = {"fid": "FID", "kid": "KID", "fid_2048": "FID-2048", "lpips_alex": "LPIPS (alex)",
              "lpips_vgg": "LPIPS (vgg)", "identity": "landmarks"}
    notes = [f"{titles[name]}: not measured: weights missing ({', '.join(networks)})."
             for name, networks in missing.items()]
    reasons: dict[tuple[str, str], list[str]] = {}
    for row in failures:
        reasons.setdefault((row["method"], row["reason"]), []).append(
            f"{row['sitter']} in {row['style']}")
    for (method, reason), where in reasons.items():
        kind = "weights missing: " if "models fetch" in reason or "the network" in reason else ""
        notes.append(f"{method}: not measured ({', '.join(where)}): {kind}{reason}")
    used: dict[str, str] = {}
    for cell in cells:
        networks = cell.facts.get("networks")
        if networks:
            used[cell.method] = (", ".join(f"{term} {name}" for term, name in networks.items())
                                 if isinstance(networks, dict) else str(networks))
    notes.append(f"content: features of the network {facts['content_network']}.")
    return notes + [f"{method}: networks: {text}." for method, text in used.items()]


def markdown_tables(facts: dict[str, Any], base: Rows, grids: Sequence[Grid],
                    study: dict[str, Any] | None, notes: Sequence[str]) -> str:
    """All tables in Markdown, with what they were measured on."""
    sizes, machine = facts["sizes"], facts["machine"]
    parts = [
        f"Sitters: {', '.join(facts['sitters'])}. Styles: {', '.join(facts['styles'])}. Seed "
        f"{facts['seed']}. Size {facts['size']}: skin of {sizes.pixels:g} pixels a unit, painted "
        f"views of {sizes.painted_size} pixels, {3 * sizes.painted_views} of them, arc of "
        f"{facts['views']} views over {facts['cone']:g} degrees at {sizes.render_size} pixels, "
        f"close views of {sizes.close_size} pixels. lfportrait {facts['version']}, "
        f"{machine['processor']}, {machine['cores']} cores. Mean ± standard deviation over sitters "
        "and styles, n cells; the best mean of a column is bold. The skin of a field is computed "
        "once a sitter, in " + ", ".join(f"{seconds:.0f} s ({name})" for name, seconds in
                                        facts["skin_seconds"].items()) + ".",
        "\n".join(f"- `{name}`: {what}" for name, what in facts["methods"].items())]
    for title, head, lines, winners in grids:
        parts += [f"### {title}", table(head, _marked(lines, winners, "**{}**"))]
        if title == GROUPS["consistency"][0]:
            parts.append(_photo_note(base))
    if study is not None:
        parts += ["### User study", _study(study)]
    parts += ["### Not measured, and with which networks",
              "\n".join(f"- {note}" for note in notes)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _photo_note(base: Rows) -> str:
    """How far apart the pairs of photos are, which are not on the arc."""
    photos = base.get("photos", {})
    texts = [f"{name} {photos[key].mean:.1f} degrees apart" for name, key in (
        ("neighbours", "short_degrees"), ("others", "long_degrees")) if key in photos]
    return f"Pairs of photos: {', '.join(texts)}." if texts else ""


def _study(study: dict[str, Any]) -> str:
    """Who was preferred to whom."""
    return table(("question", "preferred", "to", "share", "95 % interval", "answers"), [
        (row["question"], row["first"], row["second"], percent(row["share"]), interval(row),
         str(row["total"])) for row in study["preferences"]])


def _csv(cells: Sequence[Cell], floors: dict[str, dict[str, Any]]) -> str:
    """One line a cell; floors are methods of no style."""
    names = [*COLUMNS]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["sitter", "style", "method", *names])
    rows: list[tuple[str, str, str, dict[str, Any]]] = [
        (cell.sitter, cell.style, cell.method, cell.figures) for cell in cells]
    rows += [(sitter, "", name, row[name]) for sitter, row in floors.items() for name in FLOORS]
    for sitter, style, method, values in rows:
        writer.writerow([sitter, style, method, *(
            "" if values.get(name) is None else f"{values[name]:.6g}" for name in names)])
    return stream.getvalue()


def place_in(path: Path) -> tuple[str, str]:
    """The text before and after the tables in a Markdown file."""
    try:
        text = path.read_text("utf-8")
    except OSError as error:
        raise UserError(f"can't read {path}: {error.strerror}") from error
    first, last = text.find(BEGIN), text.find(END)
    if first < 0 or last < first:
        raise UserError(f"{path} has no place for the tables: it needs the lines {BEGIN} and {END}")
    return text[:first], text[last:]


def fill_document(path: Path, tables: str) -> None:
    """Put tables into a Markdown file, between the lines `BEGIN` and `END` (`place_in`)."""
    before, behind = place_in(path)
    with atomic_write(path) as stream:
        stream.write(f"{before}{BEGIN}\n\n{tables.strip()}\n\n{behind}".encode())


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
                      base: Rows, grids: Sequence[Grid], notes: Sequence[str],
                      paintings: dict[str, UInt8]) -> None:
    """Write ``index.html`` of what was measured into the run's folder, which has its pictures.

    ``paintings`` are the styles' pictures by name.
    """
    sections = [Section("What is compared", "\n\n".join(
        f"{name}: {what}" for name, what in facts["methods"].items()))]
    sections += [Section(title, tables=[Table(_marked(lines, winners, "{} (best)"), head)])
                 for title, head, lines, winners in grids]
    drawings = [chart for name in _PLOTS if (chart := _chart(name, rows, base)) is not None]
    sections.append(Section(
        "Plots", "Mean and standard deviation over sitters and styles. The dashed line is the "
        "field before style where it has the figure, 1 where 1 is best, else the first method.",
        drawings=drawings))
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
              painting: UInt8) -> Section:
    """All methods for one sitter in one style, at -45, 0 and 45 degrees."""
    folder = out / "pictures" / sitter
    pictures = [Picture(_on_strip(painting), f"{style}, the painting", width=768),
                Picture(folder / "photo.png", "the field before style", width=768)]
    pictures += [Picture(folder / style / f"{cell.method}.png", cell.method, width=768)
                 for cell in cells]
    return Section(f"{sitter} in the manner of {style}",
                   "At -45, 0 and 45 degrees.", pictures, layout="grid")


def _on_strip(painting: UInt8) -> UInt8:
    """A painting in the middle of a white strip, three times as wide as high like all others."""
    picture = Image.fromarray(painting)
    picture.thumbnail((768, 256), Image.Resampling.LANCZOS)
    strip = Image.new("RGB", (768, 256), "white")
    strip.paste(picture, ((strip.width - picture.width) // 2, 0))
    return np.asarray(strip)
