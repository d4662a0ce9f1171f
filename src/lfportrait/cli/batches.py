"""The command ``batch``: many portraits from one file."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any

import tyro

from ..errors import UserError
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
    usable_cores,
)
from .common import Common

__all__ = ["BatchCommand"]


@dataclass
class BatchCommand(Common):
    """Many portraits: the sitters, styles and displays that a file asks for.

    `lfportrait batch jobs.toml --out results/` makes them, and goes on after an interruption.
    `lfportrait batch status results/` tells how far it is. Exit code 3: some failed, all others are
    done.
    """

    jobs: tyro.conf.Positional[Path]
    """File that says what is wanted (.toml, see docs/batches.md); or the word status."""
    folder: tyro.conf.Positional[Path | None] = None
    """status: folder of a batch's results."""
    out: Path | None = None
    """Folder for all results."""
    dry_run: bool = False
    """Only show the graph, and the time and disk that it is taken to need."""
    offline: bool = False
    """Download nothing: networks that are missing are told, or done without."""
    json_lines: bool = False
    """Write each event as a line of JSON on standard output, and draw no table."""
    config: Annotated[BatchConfig, tyro.conf.arg(name="")] = option(default_factory=BatchConfig)
    """Where and how."""

    def run(self) -> dict[str, Any]:
        """Make the portraits, or tell about them."""
        if str(self.jobs) == "status":
            return self._status()
        if self.folder is not None or self.out is None:
            raise UserError(f"say where to write: lfportrait batch {self.jobs} --out results/")
        if self.dry_run:
            figures = dry_figures(prepare_batch(self.jobs, self.out, offline=self.offline,
                                                quiet=self.quiet))
            print(dry_table(figures, usable_cores()))
            return figures
        table = BatchTable()
        watchers: list[Watcher] = [table]
        if self.json_lines or self.quiet:
            watchers = [JsonLines()] if self.json_lines else []
        with contextlib.closing(table):
            figures = batch(self.jobs, self.out, self.config, offline=self.offline,
                            quiet=self.quiet or self.json_lines, watchers=watchers)
        if not self.json_lines:
            self._tell(figures)
        return figures

    def _status(self) -> dict[str, Any]:
        folder = self.folder or self.out
        if folder is None:
            raise UserError("name the folder of the results: lfportrait batch status results/")
        text, figures = batch_status(folder)
        print(text)
        return figures

    def _tell(self, figures: dict[str, Any]) -> None:
        made = sum(row["state"] == "done" for row in figures["jobs"])
        print(f"{self.out}: {made} of {len(figures['jobs'])} made, see index.html")
        for name, why in figures["failed"].items():
            print(f"failed: {name}: {why}")

    def exit_code(self, figures: dict[str, Any]) -> int:
        """3 where some portraits of a run failed."""
        return 3 if "jobs" in figures and figures["failed"] else 0
