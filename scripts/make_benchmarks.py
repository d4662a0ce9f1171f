"""Write docs/benchmarks.md, and the tables of measured figures in other documents, from a file.

`docs/measured.json` holds the figures with their machine, vectors, commit and date
(`lfportrait_eval.bench.run`); here is what they are figures of, and where they are shown. No
figure is typed into a document: ``lfportrait bench ... --record docs/measured.json`` measures, this
script writes.

Run: python scripts/make_benchmarks.py            writes the documents
     python scripts/make_benchmarks.py --check    exit code 1 if one is not up to date
"""

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lfportrait_eval.bench.run import read_measured

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "measured.json"
PAGE = ROOT / "docs" / "benchmarks.md"

HEAD = """# Benchmarks

Written by `scripts/make_benchmarks.py` from `docs/measured.json`; don't edit this page. Each row
says for which instructions its kernels were compiled, when it was measured, and with which commit
(figures from before there was this file have the commit that noted them first); where figures of
one row are from several runs, all are named. Nothing else ran on the machine.

To measure on your own machine: `lfportrait bench all --record FILE` and `lfportrait bench job
--record FILE` add their figures to such a file.
"""


@dataclass(frozen=True)
class Table:
    """One table of figures.

    Attributes
    ----------
    title, about : Its heading, and what is measured, on the page of benchmarks.
    columns : The head; a last one for the runs is added.
    rows : Cells, in which ``{name}`` is a figure of the file, and ``{name:unit}`` in another
        unit.
    documents : Others that show it, between the lines ``<!-- measured: KEY begin -->`` and
        ``end``.
    """

    title: str
    about: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    documents: tuple[str, ...] = ()


STAGES = ("capture", "reconstruct", "stylize", "encode", "share")


def _job(name: str, text: str, photos: str = "{jobs.NAME.photos}") -> tuple[str, ...]:
    """A row of whole jobs."""
    cells = (text, photos, "{jobs.NAME.seconds.total}",
             *(f"{{jobs.NAME.seconds.{stage}}}" for stage in STAGES),
             "{jobs.NAME.first_look_seconds}", "{jobs.NAME.peak_memory_bytes:GiB}",
             "{jobs.NAME.folder_bytes:MB}")
    return tuple(cell.replace("NAME", name) for cell in cells)


def _coded(name: str, text: str, direct: bool = True) -> tuple[str, ...]:
    """A row of coded panels."""
    kinds = ("seconds", "psnr", "draft_seconds", "draft_psnr")
    return (text, *(f"{{encode_scanned_head.{name}.{kind}}}" for kind in kinds),
            f"{{encode_scanned_head.{name}.direct_seconds}}" if direct else "")


TABLES = {
    "overview": Table(
        "Overview", "All stages, on two cores.", ("job", "time", "quality"), (
            ("`lfportrait demo` with no kernel compiled yet", "{jobs.demo.seconds.total}",
             "held-out views {jobs.demo.psnr} PSNR, {jobs.demo.ssim} SSIM"),
            ("`lfportrait make` on {jobs.scanned_head.photos} pictures of a scanned head "
             "(512x512, known cameras), 4K display", "{jobs.scanned_head.seconds.total}",
             "held-out views {jobs.scanned_head.psnr} PSNR, {jobs.scanned_head.ssim} SSIM"),
            ("reconstruction of the same with `--time-budget 60`, "
             "{reconstruct.scanned_head.voxels:M} voxels, "
             "{reconstruct.scanned_head.peak_memory_bytes:GB}",
             "{reconstruct.scanned_head.seconds}",
             "held-out views {reconstruct.scanned_head.psnr}"),
            ("reconstruction of 50 hand-held photos of a fox head in a room (540x960)",
             "{reconstruct.fox.seconds}",
             "held-out photos {reconstruct.fox.psnr}, exposure corrected"),
            ("reconstruction of 67 photos of a plaster head on a table (1368x770), mattes from "
             "depth", "{reconstruct.plaster_head.seconds}",
             "held-out photos {reconstruct.plaster_head.psnr}, exposure corrected, with "
             "recomputed mattes"),
            ("stylisation of a head whose skin is already computed ({stylize.skin_seconds}), "
             "VGG-16 and ResNet-50, bfloat16, {stylize.peak_memory_bytes:GiB}, with its ground",
             "{stylize.seconds}",
             "[{stylize.sharpness} of the painting's sharpness](docs/skin.md)"),
            ("coding 4K, {encode.4k.subpixels:M} sub-pixels, {encode.4k.views} views "
             "([how](docs/coding.md))", "{encode.4k.seconds}",
             "{encode.4k.psnr} to a rendering with half the step"),
            ("coding 8K, {encode.8k.subpixels:M} sub-pixels, {encode.8k.views} views",
             "{encode.8k.seconds}", "{encode.8k.psnr}"),
            ("look-up table of an exemplar (768x1024)", "{transfer.table_seconds}", "exact"),
            ("painting the head in a photo of that size: guides, synthesis, blending",
             "{transfer.painting_seconds}", "[compared with other methods](docs/methods.md)"),
            ("cameras of photos without any (960x720)", "",
             "{calibrate.around.registered} of {calibrate.around.photos} registered, median "
             "rotation error {calibrate.around.rotation_degrees} degrees, position error "
             "{calibrate.around.position_percent} % of the distance"),
            ("cameras of the same head through a long lens, with flash, in the dark", "",
             "{calibrate.dark.registered} of {calibrate.dark.photos} registered")),
        ("README.md",)),
    "jobs": Table(
        "Whole jobs",
        "`lfportrait bench job` with four captures, a 4K panel and the style \"ken\": what "
        "a portrait costs from the command to the finished folder "
        "([what bounds it](scale.md#measured-without-avx-512)).",
        ("job", "photos", "total", *STAGES, "first look", "peak memory", "folder"), (
            _job("scanned_head", "scanned head, 512x512, known cameras",
                 "{jobs.NAME.photos} + {jobs.NAME.held_out_photos} held out"),
            _job("full_wall", "sweep of +-14 degrees, 540x960, a wall full of things"),
            _job("plain_wall", "sweep of +-14 degrees, 540x960, a plain wall"),
            _job("around", "photos from all around the front, 960x720")),
        ("docs/scale.md",)),
    "coding": Table(
        "Coding a panel",
        "`lfportrait bench encode --field head.npz`: a scanned head at 384^3 with "
        "0.9 M lattice points and SH degree 2, 96 views over 40 degrees "
        "([how](coding.md#measured)).",
        ("panel", "slices", "PSNR", "`--draft`", "PSNR", "direct casting"), (
            _coded("1080p", "1920x1080"), _coded("4k", "3840x2160"), _coded("8k", "7680x4320"),
            _coded("4k_near", "3840x2160, head itself 80 % as high", False),
            _coded("8k_near", "7680x4320, head itself 80 % as high", False)),
        ("docs/coding.md",)),
}
"""All tables by the key of their markers."""

FIELD = re.compile(r"\{([\w.]+?)(?::(\w+))?\}")
SCALES = {"GiB": (2.0**30, 1), "GB": (1e9, 1), "MB": (1e6, 0), "M": (1e6, 1)}
"""What a number is divided by for a unit, and its decimals."""


def duration(seconds: float) -> str:
    """Seconds as people say them: two digits below ten where they are known, and minutes."""
    if seconds >= 60:
        minutes, rest = divmod(round(seconds), 60)
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    if seconds >= 10 or isinstance(seconds, int):
        return f"{seconds:.0f} s"
    return f"{seconds:#.2g} s"


def shown(name: str, value: float, unit: str | None) -> str:
    """A figure with its unit, which follows from its name where none is asked for."""
    if unit is not None:
        divisor, decimals = SCALES[unit]
        return f"{value / divisor:.{decimals}f} {unit}"
    if "seconds" in name.split(".")[-1] or ".seconds." in name:
        return duration(value)
    if name.endswith("psnr"):
        return f"{value:.1f} dB"
    return f"{value:g}"


def filled(cells: tuple[str, ...], known: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """The cells of a row with their figures, and the names of the runs that these come from."""
    runs: dict[str, None] = {}

    def put(match: re.Match[str]) -> str:
        name, unit = match.groups()
        value, run = known["figures"][name]
        runs.setdefault(run)
        return shown(name, value, unit)

    return [FIELD.sub(put, cell) for cell in cells], list(runs)


def conditions(runs: list[str], known: Mapping[str, Any], brief: bool) -> str:
    """Vectors and dates of runs in a few words, and their commits if it need not be brief."""
    vectors = dict.fromkeys(known["runs"][run]["vectors"] for run in runs)
    days = dict.fromkeys(
        known["runs"][run]["date"] + ("" if brief else f" `{known['runs'][run]['commit']}`")
        for run in runs)
    return f"{' / '.join(vectors)}, {', '.join([max(days)] if brief else days)}"


def machines(runs: list[str], known: Mapping[str, Any], brief: bool) -> str:
    """The machines of runs, one line, and notes on them if it need not be brief."""
    found = dict.fromkeys(f"{known['runs'][run]['machine']['processor']}, cores: "
                          f"{known['runs'][run]['machine']['cores']}" for run in runs)
    notes = dict.fromkeys(f"`{known['runs'][run]['commit']}`: {known['runs'][run]['note']}"
                          for run in runs if "note" in known["runs"][run])
    return "; ".join(found) + "." + ("" if brief else "".join(f" {note}." for note in notes))


def table(key: str, known: Mapping[str, Any], brief: bool = False) -> str:
    """One table as Markdown, with the line of its machine; a brief one names no commits."""
    entry, all_runs = TABLES[key], dict[str, None]()
    lines = [[*entry.columns, "kernels, measured"], ["---"] * (len(entry.columns) + 1)]
    for cells in entry.rows:
        row, runs = filled(cells, known)
        all_runs.update(dict.fromkeys(runs))
        lines.append([*row, conditions(runs, known, brief)])
    text = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return f"{machines(list(all_runs), known, brief)}\n\n{text}"


def page(known: Mapping[str, Any]) -> str:
    """The page of benchmarks."""
    parts = [HEAD]
    for key, entry in TABLES.items():
        # The page lies in the folder that README's links lead into.
        text = table(key, known).replace("(docs/", "(")
        parts.append(f"## {entry.title}\n\n{entry.about}\n\n{text}\n")
    return "\n".join(parts)


def put_into(text: str, key: str, block: str) -> str:
    """A document with another table between its markers."""
    begin, end = f"<!-- measured: {key} begin -->", f"<!-- measured: {key} end -->"
    if text.count(begin) != 1 or text.count(end) != 1:
        raise SystemExit(f"a document needs one {begin} and one {end}")
    before, rest = text.split(begin)
    return f"{before}{begin}\n{block}\n{end}{rest.split(end)[1]}"


def documents(known: Mapping[str, Any], root: Path = ROOT) -> dict[Path, str]:
    """All documents with figures, as they should be."""
    found = {root / PAGE.relative_to(ROOT): page(known)}
    for key, entry in TABLES.items():
        for name in entry.documents:
            path = root / name
            text = found.get(path) or path.read_text("utf-8")
            found[path] = put_into(text, key, table(key, known, name == "README.md"))
    return found


def main() -> int:
    wanted = documents(read_measured(FIGURES))
    stale = [path for path, text in wanted.items()
             if not path.is_file() or path.read_text("utf-8") != text]
    if "--check" in sys.argv[1:]:
        for path in stale:
            print(f"{path.relative_to(ROOT)} is out of date: run make_benchmarks.py")
        return 1 if stale else 0
    for path in stale:
        path.write_text(wanted[path], "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
