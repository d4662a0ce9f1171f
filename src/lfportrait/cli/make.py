"""The commands ``make``, ``batch`` and ``studio``: whole jobs."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass, replace
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from ..errors import UserError
from ..job import FULL, QUICK, MakeConfig, make
from ..job.batch import (
    BatchConfig,
    BatchTable,
    JsonLines,
    Watcher,
    batch,
    batch_status,
    dry_figures,
    dry_table,
    prepare_batch,
)
from ..measure import usable_cores
from .common import Common


def _told(run: dict[str, Any], out: Path, quiet: bool, begun: float) -> dict[str, Any]:
    """Say where the results are, and the seconds since the command began; return the figures."""
    if not quiet and "share" not in run["seconds"]:
        print(f"{out / 'portrait.html'}: a first look; the same command without --quick goes on "
              "from there")
    elif not quiet:
        print(f"{out}: portrait.html, lightfield.png, report.html "
              f"({time.perf_counter() - begun:.0f} s in all)")
    return run


@dataclass
class Make(Common):
    """Make a stylised 3D portrait for a display from photos of a person and one painting.

    Run the same command again to resume an interrupted job.
    """

    photos: tyro.conf.Positional[Path]
    """One photo, a folder of some or many, a video, or a data set with cameras (`lfportrait
    formats`)."""
    style: str
    """Exemplar: a picture (landmarks beside it or detected) or a name from `lfportrait styles`."""
    out: Path
    """Folder for all results."""
    display: str = "generic-4k"
    """Display preset (`lfportrait display list`) or a display or calibration file."""
    offline: bool = False
    """Download nothing."""
    quick: bool = False
    """End with the first look; the same command without --quick goes on from there."""
    first_look: bool = True
    """Write a rough portrait.html early on."""
    config: Annotated[MakeConfig, tyro.conf.arg(name="")] = option(default_factory=MakeConfig)
    """Parameters of the stages."""

    groups: ClassVar[dict[str, str]] = {"stylize.": "lfportrait.field_methods"}
    usual: ClassVar[tuple[str, ...]] = ("from", "stylize.method", "stylize.strength")

    def run(self) -> dict[str, Any]:
        begun = time.perf_counter()
        config = replace(self.config, stylize=replace(self.config.stylize, parameters=self.given))
        run = make(self.photos, self.style, self.out, self.display, config,
                   device=self.device, seed=self.seed, quiet=self.quiet, offline=self.offline,
                   first_look=self.first_look, quick=self.quick)
        if self.quick and not self.quiet and "share" in run["seconds"]:
            print("the portrait is finished already")
        return _told(run, self.out, self.quiet, begun)


@dataclass
class Demo(Common):
    """Run all stages on the photos and the painting that come with the package."""

    out: Path = Path("demo-out")
    """Folder for all results."""
    style: str = ""
    """Another exemplar: a picture or a name from `lfportrait styles`."""
    quick: bool = False
    """A small demo, about a minute on two cores once its kernels are compiled: fewer and smaller
    photos, a coarser field and skin, a Full-HD display. It tests the installation; quality is
    lower."""
    display: str = ""
    """Display preset or file; by default generic-4k, and generic-1080p with --quick."""
    size: int = 0
    """Width and height of the photos in pixels, at most 384; by default 384, and 256 with
    --quick."""
    views: int = 0
    """Number of photos, at most 60; by default 60, and 32 with --quick."""

    def run(self) -> dict[str, Any]:
        from ..demo import demo_capture, demo_exemplar

        begun = time.perf_counter()
        scale = QUICK if self.quick else FULL
        capture = demo_capture(size=self.size or scale.size, views=self.views or scale.views)
        style = self.style or demo_exemplar(width=scale.exemplar * 3 // 4, height=scale.exemplar)
        run = make(capture, style, self.out, self.display or scale.display, scale.config,
                   device=self.device, seed=self.seed, quiet=self.quiet)
        return _told(run, self.out, self.quiet, begun)


@dataclass
class BatchCommand(Common):
    """Make many portraits: all sitters, styles and displays listed in a jobs file.

    `lfportrait batch jobs.toml --out results/` runs or resumes the batch. `lfportrait batch status
    results/` shows its progress. Exit code 3: some jobs failed, all others are done.
    """

    jobs: tyro.conf.Positional[Path]
    """Jobs file (.toml, see docs/batches.md)."""
    out: Path | None = None
    """Folder for all results."""
    dry_run: bool = False
    """Only show the graph, with the estimated time and disk space."""
    offline: bool = False
    """Download nothing: missing networks are reported, or replaced by simpler methods."""
    json_lines: bool = False
    """Write each event as a line of JSON to standard output instead of drawing a table."""
    config: Annotated[BatchConfig, tyro.conf.arg(name="")] = option(default_factory=BatchConfig)
    """Where and how."""

    def run(self) -> dict[str, Any]:
        if self.out is None:
            raise UserError(f"--out is missing: lfportrait batch {self.jobs} --out results/")
        if self.dry_run:
            figures = dry_figures(prepare_batch(
                self.jobs, self.out, made_from=self.config.made_from, offline=self.offline,
                quiet=self.quiet))
            print(dry_table(figures, usable_cores()))
            return figures
        table = BatchTable()
        watchers: list[Watcher] = [table]
        if self.json_lines or self.quiet:
            watchers = [JsonLines()] if self.json_lines else []
        with contextlib.closing(table):
            figures = batch(self.jobs, self.out, self.config, offline=self.offline,
                            quiet=self.quiet or self.json_lines, watchers=watchers,
                            device=self.device)
        if not self.json_lines:
            self._tell(figures)
        return figures

    def _tell(self, figures: dict[str, Any]) -> None:
        made = sum(row["state"] == "done" for row in figures["jobs"])
        print(f"{self.out}: {made} of {len(figures['jobs'])} made, see index.html")
        for name, why in figures["failed"].items():
            print(f"failed: {name}: {why}")

    def exit_code(self, figures: dict[str, Any]) -> int:
        """3 where some portraits of a run failed."""
        return 3 if "jobs" in figures and figures["failed"] else 0


@dataclass
class BatchStatus(Common):
    """Show how far a batch is: what is done, what failed and why, how long the rest takes."""

    folder: tyro.conf.Positional[Path]
    """Folder of the batch's results."""

    def run(self) -> dict[str, Any]:
        text, figures = batch_status(self.folder)
        print(text)
        return figures


@dataclass
class Studio(Common):
    """Open the studio in the browser: photos, making, styles, mixes, panels and exports.

    A page on this machine alone, for people who paint and do not type. Its projects are folders
    that the other commands read. Ctrl-C ends it; what was being made goes on the next time.
    """

    folder: Path = Path("portraits")
    """Folder of the projects, one folder a sitter; made if it does not exist."""
    port: int = 0
    """Port on the loopback address; by default a free one."""
    browser: bool = True
    """Open the browser; otherwise only print the address."""

    def run(self) -> dict[str, Any]:
        try:
            from ..studio import run
        except ModuleNotFoundError as error:
            package = (error.name or "").partition(".")[0]
            if package not in ("starlette", "uvicorn"):
                raise
            raise UserError(f"the studio needs {package}: pip install "
                            "'lfportrait[studio]'") from error
        run(self.folder, self.port, browse=self.browser, quiet=self.quiet)
        return {"folder": self.folder}
