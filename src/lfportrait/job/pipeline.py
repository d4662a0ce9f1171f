"""The main job: photos and one painting in, a coded light field out, each stage resumable.

It is the graph of one portrait (`graph`), done in its own process. The stages in order, each of
which writes its files into the job's folder and is skipped when they are there from the same inputs
(`lfportrait.stages`):

==============  ==============================  ===================================
stage           reads                           writes
==============  ==============================  ===================================
capture         photos                          ``capture/``
reconstruct     ``capture/``                    ``field.npz``
stylize         field, capture, exemplar        ``styled.npz``
encode          styled field, display           ``lightfield.png``, ``quilt_*.png``
share           all of them                     ``portrait.html``, ``sweep.mp4``,
                                                ``report.html``
==============  ==============================  ===================================
"""

from __future__ import annotations

import sys
import warnings
from functools import partial
from pathlib import Path
from typing import Any

from .. import models
from ..capture import Capture
from ..device import gpu_adapter, used_device
from ..errors import UserError
from ..example import Exemplar
from ..files import write_json
from ..lightfield import Display
from ..measure import machine, peak_memory_bytes
from ..stages import StageFolder, check_writable
from ..version import __version__
from .graph import (
    Plan,
    Task,
    capture_key,
    code_key,
    field_key,
    share_key,
    style_key,
)
from .networks import get_networks
from .steps import MakeConfig, fitted, look_at, painting_key, source_key
from .warmup import Warmup
from .work import Tools, do_stage

__all__ = ["MakeConfig", "make", "run_figures"]


def make(photos: Path | Capture, style: str | Path | Exemplar, out: Path,
         display: str | Path | Display = "generic-4k", config: MakeConfig | None = None, *,
         device: str = "auto", seed: int = 0, quiet: bool = True, offline: bool = False,
         warmup: Warmup | None = None) -> dict[str, Any]:
    """Run the whole job.

    Parameters
    ----------
    photos
        Folder of photos, video, calibrated data set, or a capture in memory.
    style
        Exemplar: a picture's path, a built-in style's name, or an `Exemplar`.
    out
        Folder for all results; an interrupted job is resumed.
    display
        Preset name, calibration or display file, or a `Display`.
    config
        Parameters of the stages.
    device
        Where to compute: ``"auto"``, ``"cpu"``, ``"gpu"`` or ``"gpu:NAME"`` (`lfportrait.device`).
    seed
        Seed of all random choices.
    quiet
        Print no progress.
    offline
        Download no networks: what is missing is an error, or done without and said so.
    warmup
        Kernels that are being compiled already (`Warmup`); by default the job begins that itself.

    Returns
    -------
    run
        The figures that ``run.json`` holds.

    Raises
    ------
    UserError
        If an input can't be used; nothing half-written is left.
    """
    config = config or MakeConfig()
    # Everything that can be wrong in the input is looked at before the first long stage starts.
    panel = display if isinstance(display, Display) else Display.resolve(display)
    if not isinstance(photos, Capture) and not Path(photos).exists():
        raise UserError(f"there is no folder or file {photos}; name the folder of your photos")
    if not isinstance(style, Exemplar) and not Path(style).is_file():
        style = Exemplar.load(style)  # a name: it needs no network
    check_writable(Path(out))
    gpu_adapter(device)  # a GPU that is not here is told now, not when the picture is coded
    models.require(config.stylize.networks, download=not offline, quiet=quiet,
                   purpose=f"--method {config.stylize.method}")
    if not isinstance(photos, Capture):
        look_at(Path(photos))
        get_networks(Path(photos), None if isinstance(style, Exemplar) else Path(style),
                     config.keep_background, offline=offline, quiet=quiet)
    exemplar = style if isinstance(style, Exemplar) else Exemplar.load(style)
    config = fitted(config, [(panel, config.encode)])
    job = _Job(Path(out), photos, exemplar, panel, config, device, seed, quiet)
    with warmup or Warmup(("reconstruct", "transfer", "stylize", "encode")) as job.tools.warmup:
        return job.run()


def _plan(photos: Path | Capture, exemplar: Exemplar, display: Display, config: MakeConfig,
          seed: int) -> Plan:
    """The tasks of one portrait in one folder."""
    kept = "capture", "field.npz", "styled.npz"
    files = dict(zip(("capture", "field", "styled"), kept))
    capture = capture_key(source_key(photos), config, seed)
    field = field_key(capture, config)
    style = style_key(field, config, painting_key(exemplar))
    code = code_key(style, config, display)
    found: dict[str, Task] = {}
    for name, stage, key, outputs in (
            ("capture", "capture", capture, (kept[0],)),
            ("reconstruct", "field", field, (kept[1],)),
            ("stylize", "stylize", style, (kept[2],)),
            ("encode", "encode", code, ("lightfield.png",)),
            ("share", "share", share_key(code, config),
             ("portrait.html", "sweep.mp4", "report.html"))):
        found[name] = Task(name, stage, "", outputs, key, tuple(found), config, seed, files,
                           source="" if isinstance(photos, Capture) else str(photos),
                           display=display)
    return Plan(found)


class _Job:
    """One run of the main job: the tasks of one portrait, one after the other, here."""

    def __init__(self, out: Path, photos: Path | Capture, exemplar: Exemplar, display: Display,
                 config: MakeConfig, device: str, seed: int, quiet: bool) -> None:
        self.out, self.exemplar, self.display, self.quiet = out, exemplar, display, quiet
        self.plan = _plan(photos, exemplar, display, config, seed)
        self.stages = StageFolder(out, self._say)
        self.tools = Tools(shown=not quiet, device=device, exemplar=exemplar,
                           capture=photos if isinstance(photos, Capture) else None,
                           sheet=out.with_name(f"{out.name}-photos.jpg"))

    def _say(self, line: str) -> None:
        if not self.quiet:
            print(line, file=sys.stderr)

    def run(self) -> dict[str, Any]:
        for task in self.plan.tasks.values():
            self.stages.run(task.name, task.key, task.outputs, partial(self._done, task))
        run = self._figures()
        write_json(self.out / "run.json", run)
        return run

    def _done(self, task: Task) -> dict[str, Any]:
        figures = do_stage(task, self.out, self.stages, self.tools, self.stages.figures)
        if task.stage == "field":
            self._compare_arcs(figures)
        return {**figures, "peak_memory_bytes": peak_memory_bytes()}

    def _compare_arcs(self, figures: dict[str, Any]) -> None:
        """Say so where the display shows more than the photos do."""
        span = figures.get("geometry", {}).get("span_degrees", 360.0)
        if span < self.display.cone:
            warnings.warn(
                f"the photos cover {span:.0f} degrees around the head, {self.display.name} shows "
                f"{self.display.cone:.0f}: its outer views are partly extrapolated "
                "(report.html shows where); take photos from further left and right", stacklevel=2)

    def _figures(self) -> dict[str, Any]:
        return run_figures(self.stages.figures, self.exemplar.name, self.display.name,
                           self.stages.resumed)


def run_figures(figures: dict[str, dict[str, Any]], style: str, display: str,
                resumed: list[str]) -> dict[str, Any]:
    """What ``run.json`` says of a job.

    Parameters
    ----------
    figures
        Of its stages, by name.
    style, display
        Names of the painting and of the panel.
    resumed
        Names of the stages that were done before.
    """
    seconds = {name: stage["stage_seconds"] for name, stage in figures.items()}
    peak = max([peak_memory_bytes(), *(int(stage.get("peak_memory_bytes", 0))
                                       for stage in figures.values())])
    return {"version": __version__, "device": used_device(figures), "machine": machine(),
            "style": style, "display": display,
            "seconds": {"total": round(sum(seconds.values()), 3), **seconds},
            "peak_memory_bytes": peak, "resumed": resumed, **figures}
