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

import contextlib
import sys
import time
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from .. import models
from ..cache import hash_of
from ..capture import Capture
from ..device import gpu_adapter, used_device
from ..errors import UserError
from ..example import Exemplar
from ..field import VoxelField
from ..files import write_json
from ..lightfield import Display
from ..measure import machine, peak_memory_bytes
from ..runner import Here, Outcome, finished, run_tasks
from ..simd.host import compiling_progress
from ..stages import StageFolder, check_writable
from ..version import __version__
from .first_look import LookTaken, PageLook
from .graph import (
    STAGES,
    MakeConfig,
    Task,
    capture_key,
    code_key,
    field_key,
    fitted,
    look_at,
    painting_key,
    portrait_tasks,
    share_key,
    source_key,
    style_key,
)
from .networks import get_networks
from .time_left import Source, TimeLeft
from .warmup import Warmup, head_kernels, import_ahead
from .work import Tools, do_stage


def make(photos: Path | Capture, style: str | Path | Exemplar, out: Path,
         display: str | Path | Display = "generic-4k", config: MakeConfig | None = None, *,
         device: str = "auto", seed: int = 0, quiet: bool = True, offline: bool = False,
         first_look: bool = True, quick: bool = False) -> dict[str, Any]:
    """Run the whole job.

    While the field is made, a first look is written as ``portrait.html`` (`first_look`).

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
    first_look
        Write the first look; all other files are the same without it.
    quick
        End with the first look. The same call without this goes on from there.

    Returns
    -------
    run
        The figures that ``run.json`` holds; ``first_look`` has the seconds to the first look,
        where there was one.

    Raises
    ------
    UserError
        If an input can't be used; nothing half-written is left.
    """
    begun = time.perf_counter()
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
    source = Source.of(photos, config)
    with Warmup(head_kernels(source.fitted, source.matted)) as job.tools.warmup:
        if not quiet:
            job.look_ahead(TimeLeft(config, source, look=first_look,
                                    only=quick, warmup=job.tools.warmup))
        if first_look or quick:
            job.look_early(begun, only=quick)
        if not (source.placed or finished(job.tasks["capture"], job.out)):
            # Not torch: memory between its own is not given back, up to 1 GB more at the peak.
            import_ahead("mediapipe.tasks.python")
        return job.run()


def _tasks(photos: Path | Capture, exemplar: Exemplar, display: Display, config: MakeConfig,
           seed: int) -> dict[str, Task]:
    """The tasks of one portrait in one folder."""
    keys = {"capture": capture_key(source_key(photos), config, seed)}
    keys["reconstruct"] = field_key(keys["capture"], config)
    keys["stylize"] = style_key(keys["reconstruct"], config, painting_key(exemplar))
    keys["encode"] = code_key(keys["stylize"], config, display)
    keys["share"] = share_key(keys["encode"], config)
    tasks = portrait_tasks(
        keys, config, seed, display=display,
        source="" if isinstance(photos, Capture) else str(photos),
        inputs={"capture": "capture", "field": "field.npz", "styled": "styled.npz"})
    return {task.name: task for task in tasks}


class _Job:
    """One run of the main job: the tasks of one portrait, one after the other, here."""

    def __init__(self, out: Path, photos: Path | Capture, exemplar: Exemplar, display: Display,
                 config: MakeConfig, device: str, seed: int, quiet: bool) -> None:
        self.out, self.exemplar, self.display, self.quiet = out, exemplar, display, quiet
        self.config, self.seed = config, seed
        self.tasks = _tasks(photos, exemplar, display, config, seed)
        self.stages = StageFolder(out, self._say)
        self.tools = Tools(shown=not quiet, device=device, exemplar=exemplar,
                           capture=photos if isinstance(photos, Capture) else None,
                           sheet=out.with_name(f"{out.name}-photos.jpg"))

    def _say(self, line: str) -> None:
        if not self.quiet:
            print(line, file=sys.stderr)

    def look_ahead(self, outlook: TimeLeft) -> None:
        """Show the time that is left of what is not done yet."""
        for task in self.tasks.values():
            if finished(task, self.out) is not None:
                outlook.skip(STAGES[task.stage].title)
        self.tools.outlook = outlook

    def look_early(self, begun: float, *, only: bool) -> None:
        """Take a first look as soon as that is possible; ``only``: and end the job with it."""
        tasks, config = self.tasks, self.config
        look = PageLook(self.stages, hash_of(tasks["stylize"].key, config.page), self.exemplar,
                        replace(config.stylize, seed=self.seed), config.page, config.encode, begun,
                        only=only)
        look.warmup = self.tools.warmup
        # The finished page is no worse.
        look.over = look.over or finished(tasks["share"], self.out) is not None
        self.tools.look = look

    def run(self) -> dict[str, Any]:
        with contextlib.suppress(LookTaken):
            run_tasks(self.tasks.values(), Here(self._do))
        run = self._figures()
        write_json(self.out / "run.json", run)
        return run

    def _do(self, task: Task) -> Outcome:
        """Do a task, unless it was done before or the job is to end with the first look."""
        look = self.tools.look
        if look is not None and finished(task, self.out) is None:
            if look.over and look.only:
                return Outcome(task.name)
            if task.stage == "stylize" and not look.over:
                self._look_at_finished()
        return Outcome(task.name, figures=self.stages.run(
            task.record, task.key, task.outputs, partial(self._done, task)))

    def _look_at_finished(self) -> None:
        """Take the first look of the finished field: the painting is new, or kernels were late.

        The next stage waits for these kernels in any case.
        """
        look, capture = self.tools.look, Capture.load(self.out / "capture")
        assert look is not None
        with compiling_progress("first look", enabled=not self.quiet) as progress:
            look.offer(progress, capture, lambda: self.tools.kept.get("field") or VoxelField.load(
                self.out / "field.npz"), wait=True)

    def _done(self, task: Task) -> dict[str, Any]:
        figures = do_stage(task, self.out, self.stages, self.tools, self.stages.figures)
        if task.stage == "field":
            self._compare_arcs(figures)
        return figures

    def _compare_arcs(self, figures: dict[str, Any]) -> None:
        """Say so where the display shows more than the photos do."""
        span = figures.get("geometry", {}).get("span_degrees", 360.0)
        if span < self.display.cone:
            warnings.warn(
                f"the photos cover {span:.0f} degrees around the head, {self.display.name} shows "
                f"{self.display.cone:.0f}: its outer views are partly extrapolated "
                "(report.html shows where); take photos from further left and right", stacklevel=2)

    def _figures(self) -> dict[str, Any]:
        run = run_figures(self.stages.figures, self.exemplar.name, self.display.name,
                          self.stages.resumed)
        look = self.tools.look
        return {**run, "first_look": look.figures} if look is not None and look.figures else run


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
