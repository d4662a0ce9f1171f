"""Commands of measurement and upkeep: ``evaluate``, ``bench``, ``models``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro

from ..errors import UserError
from .common import Common

__all__ = ["Bench", "Evaluate", "Models"]


@dataclass
class Evaluate(Common):
    """Measure a finished job: held-out views, consistency between views, style and identity."""

    job: tyro.conf.Positional[Path]
    """Folder that `lfportrait make` or `demo` wrote."""
    style: str = ""
    """The job's exemplar, for the distances to the style."""

    def run(self) -> dict[str, Any]:
        """Measure and print."""
        from ..evaluate import evaluate_job
        from ..example import Exemplar

        exemplar = Exemplar.load(self.style) if self.style else None
        with self.progress("evaluate") as progress:
            figures = evaluate_job(self.job, exemplar, progress=progress)
        for name, value in sorted(_flat(figures).items()):
            print(f"{name:<44} {value:.4g}" if isinstance(value, float) else f"{name:<44} {value}")
        return figures


@dataclass
class Bench(Common):
    """Measure speed, ratios side by side in one run."""

    what: tyro.conf.Positional[Literal["encode", "reconstruct", "transfer", "stylize", "all"]]
    """Which stage."""
    field: Path | None = None
    """Field file to code and render; without it, the embedded head is reconstructed first."""
    capture: Path | None = None
    """Capture to reconstruct and stylise; the embedded one by default."""
    full: bool = False
    """Reconstruct by the default schedule, which takes minutes, instead of a short one."""
    plot: Path | None = None
    """Write the reconstruction's PSNR over time as a picture to this file."""

    def run(self) -> dict[str, Any]:
        """Measure and print."""
        from ..evaluate.bench import bench, transfer_table

        with self.progress("bench") as progress:
            figures = bench(self.what, field=self.field, capture=self.capture, plot=self.plot,
                            full=self.full, progress=progress)
        for name, value in _flat(figures).items():
            if ".curve." in f".{name}":  # for --json and the plot
                continue
            print(f"{name:<44} {value:.4g}" if isinstance(value, float) else f"{name:<44} {value}")
        if self.what in ("transfer", "all"):
            print(transfer_table(figures if self.what == "transfer" else figures["transfer"]))
        return figures


@dataclass
class Models(Common):
    """List, fetch and add the pretrained networks."""

    action: tyro.conf.Positional[Literal["list", "fetch", "add"]] = "list"
    """What to do."""
    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Networks or groups to fetch (portrait by default, those of the main job), or files to add."""

    def run(self) -> dict[str, Any]:
        """Do what ``action`` says."""
        from .. import models

        if self.action == "list":
            print("\n".join(models.listing()))
        elif self.action == "fetch":
            for name in models.expand(self.names or ("portrait",)):
                print(f"{name}: {models.fetch(name, quiet=self.quiet)}")
        else:
            if not self.names:
                raise UserError("name the file to add: lfportrait models add FILE")
            for name in self.names:
                print(f"{name}: {models.add(Path(name))}")
        return {"models": {name: models.available(name) for name in models.registry()}}


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
