"""Commands of measurement: ``evaluate``, ``evaluate tables``, ``bench``, ``study``."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass, replace
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import tyro

from lfportrait.cli import Common
from lfportrait.errors import UserError

from .study import StudyConfig
from .tables import TablesConfig


@dataclass
class Evaluate(Common):
    """Measure a finished job: held-out views, consistency between views, style, identity."""

    job: tyro.conf.Positional[Path]
    """Folder that `lfportrait make` or `demo` wrote."""
    style: str = ""
    """The job's exemplar, for the distances to the style."""

    def run(self) -> dict[str, Any]:
        """Measure and print."""
        from lfportrait.example import Exemplar

        from .metrics import evaluate_job

        exemplar = Exemplar.load(self.style) if self.style else None
        with self.progress("evaluate") as progress:
            figures = evaluate_job(self.job, exemplar, progress=progress, device=self.device)
        _print(sorted(_flat(figures).items()))
        return figures


@dataclass
class Tables(Common):
    """Compare methods as in the paper, on the same sitters, styles and views.

    Writes tables.md, tables.csv, tables.json and index.html. It takes about a minute for each
    sitter, style and method; run the same command again to resume.
    """

    capture: tuple[str, ...] = ()
    """Sitters: CAPTURE, NAME=CAPTURE or NAME=CAPTURE:FIELD each. Without a field, one is
    reconstructed and kept."""
    styles: tuple[str, ...] = ()
    """Exemplars: pictures, or names from `lfportrait styles`."""
    field: tuple[str, ...] = ()
    """Field files, in the order of the captures."""
    out: Path = Path("tables")
    """Folder for the tables and all intermediate results."""
    document: Path | None = None
    """Markdown file to insert the tables into, between the lines <!-- tables: begin --> and <!--
    tables: end -->."""
    config: Annotated[TablesConfig, tyro.conf.arg(name="")] = option(default_factory=TablesConfig)
    """Methods and sizes of the comparison."""

    groups: ClassVar[dict[str, str]] = {"stylize.": "lfportrait.field_methods"}

    def run(self) -> dict[str, Any]:
        """Measure and write."""
        from lfportrait.capture import CalibrateConfig
        from lfportrait.example import Exemplar
        from lfportrait.job import prepare_capture

        from .tables import fill_document, place_in, sources_of, write_tables

        sources = sources_of(self.capture, self.field)
        config = replace(self.config, stylize=replace(self.config.stylize, parameters=self.given))
        exemplars = [Exemplar.load(style) for style in self.styles]
        if self.document is not None:
            place_in(self.document)
        with self.progress("tables") as progress:
            figures = write_tables(
                sources, exemplars, self.out, config, seed=self.seed, progress=progress,
                device=self.device,
                open_capture=lambda path: prepare_capture(path, CalibrateConfig(seed=self.seed),
                                                          need_face=True, progress=progress)[0])
        text = (self.out / "tables.md").read_text("utf-8")
        print(text)
        if self.document is not None:
            fill_document(self.document, text)
        print(f"{self.out / 'index.html'}: {len(figures['cells'])} cells")
        return figures


@dataclass
class Bench(Common):
    """Measure speed; methods are compared within one run.

    `lfportrait bench job` makes whole portraits, each in a process of its own, and prints what each
    cost as Markdown tables. Exit code 2: some jobs failed, the figures are those of all others.
    """

    what: tyro.conf.Positional[Literal["encode", "print", "reconstruct", "transfer", "stylize",
                                       "all", "job"]]
    """Stage to measure; all: every stage; job: whole jobs."""
    field: Path | None = None
    """Field file to encode, print and render; by default the embedded head is reconstructed
    first."""
    capture: Path | None = None
    """Capture to reconstruct and stylise; the embedded one by default."""
    full: bool = False
    """Reconstruct with the default schedule (minutes) instead of a short one."""
    plot: Path | None = None
    """Write the reconstruction's PSNR over time as a picture to this file."""
    captures: tuple[Path, ...] = ()
    """Folders of photos, videos or data sets to make whole jobs of; by default the demo's head."""
    style: str = "fauve"
    """Exemplar of the whole jobs: a picture or a name from `lfportrait styles`."""
    display: str = "generic-4k"
    """Display of the whole jobs: a preset (`lfportrait display list`) or a file."""
    repeat: int = 1
    """Runs of each whole job; the one with the median time is reported."""
    record: Path | None = None
    """Add the figures to this file of measured figures (JSON), with machine, vectors, commit and
    date: docs/benchmarks.md is written from docs/measured.json."""

    def run(self) -> dict[str, Any]:
        """Measure, print and record."""
        from .bench import read_measured, record

        if self.record is not None:
            read_measured(self.record)  # what can't be added to is refused before anything runs
        figures = self._jobs() if self.what == "job" else self._stages()
        if self.record is not None:
            record(self.record, self.what, figures, f"lfportrait bench {self.what}")
        return figures

    def exit_code(self, figures: dict[str, Any]) -> int:
        """0; what failed is said here, when ``--json`` has the figures of all others."""
        failed = figures.get("failed", {})
        if failed:
            raise UserError(f"{len(failed)} of {len(failed) + len(figures['jobs'])} jobs failed: "
                            + "; ".join(f"{name}: {why}" for name, why in failed.items()))
        return 0

    def _jobs(self) -> dict[str, Any]:
        from .bench import bench_jobs, job_tables

        with self.progress("bench") as progress:
            figures = bench_jobs(self.captures, style=self.style, display=self.display,
                                 repeats=self.repeat, device=self.device, seed=self.seed,
                                 progress=progress)
        print(job_tables(figures))
        return figures

    def _stages(self) -> dict[str, Any]:
        from .bench import bench, transfer_table

        with self.progress("bench") as progress:
            figures = bench(self.what, field=self.field, capture=self.capture, plot=self.plot,
                            full=self.full, progress=progress, device=self.device)
        _print((name, value) for name, value in _flat(figures).items()
               if ".curve." not in f".{name}")  # that is for --json and the plot
        if self.what in ("transfer", "all"):
            print(transfer_table(figures if self.what == "transfer" else figures["transfer"]))
        return figures


@dataclass
class Study(Common):
    """Make a user study page on which people choose between portraits.

    `lfportrait study results` evaluates the participants' answer files.
    """

    jobs: tyro.conf.Positional[tuple[str, ...]] = ()
    """Folders of jobs, or videos SITTER/STYLE/METHOD.mp4; METHOD=PATH or METHOD:SITTER:STYLE=PATH
    names them."""
    out: Path = Path("study")
    """Folder for the page."""
    config: Annotated[StudyConfig, tyro.conf.arg(name="")] = option(default_factory=StudyConfig)
    """Questions, pairs and layout."""

    def run(self) -> dict[str, Any]:
        """Write the page."""
        from .study import write_study

        if not self.jobs:
            raise UserError("name the portraits to compare: lfportrait study JOB JOB ...; or "
                            "evaluate: lfportrait study results answers/*.json")
        with self.progress("study", len(self.jobs)) as progress:
            figures = write_study(self.jobs, self.out, self.config, seed=self.seed,
                                  progress=progress)
        print(f"{self.out / 'index.html'}: {', '.join(figures['methods'])}; pairs: "
              f"{figures['pairs']}, answers of each person: {figures['answers_per_person']}")
        return figures


@dataclass
class StudyResults(Common):
    """Evaluate the answers to a user study."""

    answers: tyro.conf.Positional[tuple[str, ...]] = ()
    """Answer files."""
    out: Path = Path("study-results")
    """Folder for the results."""
    study: Path | None = None
    """The study.json of the study, or its folder, to check the answers against."""

    def run(self) -> dict[str, Any]:
        """Evaluate, write and print."""
        from .study import write_results

        figures = write_results(self.answers, self.out, study=self.study, seed=self.seed)
        for entry in figures["left_out"]:
            print(f"left out: {entry['file']}: {entry['reason']}", file=sys.stderr)
        for row in figures["preferences"]:
            print(f"{row['question']:<12} {row['first']} over {row['second']}: "
                  f"{100 * row['share']:.1f} % of {row['total']} "
                  f"({100 * row['low']:.1f} to {100 * row['high']:.1f} %), "
                  f"p = {row['p_holm']:.2g}")
        print(f"{self.out / 'results.md'}: people: {figures['people']}, "
              f"answers: {figures['answers']}")
        return figures


def _print(figures: Iterable[tuple[str, Any]]) -> None:
    for name, value in figures:
        print(f"{name:<44} {value:.4g}" if isinstance(value, float) else f"{name:<44} {value}")


def _flat(figures: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested figures as one level of dotted names."""
    rows: dict[str, Any] = {}
    for name, value in figures.items():
        if isinstance(value, dict):
            rows.update(_flat(value, f"{prefix}{name}."))
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for index, item in enumerate(value):
                rows.update(_flat(item, f"{prefix}{name}.{index}."))
        else:
            rows[prefix + name] = value
    return rows
