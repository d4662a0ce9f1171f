"""The main job: photos and one painting in, a coded light field out, each stage resumable.

The stages in order, each of which writes its files into the job's folder and is skipped when they
are there from the same inputs (`lfportrait.stages`):

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
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from .. import models
from ..cache import key_of
from ..capture import Capture
from ..device import computing_device
from ..errors import UserError
from ..example import Exemplar
from ..field import VoxelField
from ..files import write_json
from ..lanes.compiling import compiling_progress
from ..lightfield import Display
from ..measure import machine, peak_memory_bytes
from ..progress import Progress
from ..stages import StageFolder, check_writable
from ..version import __version__
from .networks import get_networks
from .prepare import prepare_capture
from .steps import (
    MakeConfig,
    capture_key,
    code_key,
    field_key,
    fitted,
    look_at,
    painting_key,
    save_folder,
    source_key,
    style_key,
    write_code,
    write_field,
    write_styled,
)
from .summary import share_job
from .warmup import Warmup

__all__ = ["MakeConfig", "make"]


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
        Folder for all results; a job interrupted there goes on where it stopped.
    display
        Preset name, calibration or display file, or a `Display`.
    config
        Parameters of the stages.
    device
        Where to compute: ``"auto"`` or ``"cpu"`` (`lfportrait.device.computing_device`).
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
    models.require(config.stylize.networks, download=not offline, quiet=quiet,
                   purpose=f"--method {config.stylize.method}")
    if not isinstance(photos, Capture):
        look_at(Path(photos))
        get_networks(Path(photos), None if isinstance(style, Exemplar) else Path(style),
                     config.keep_background, offline=offline, quiet=quiet)
    exemplar = style if isinstance(style, Exemplar) else Exemplar.load(style)
    config = fitted(config, [(panel, config.encode)])
    job = _Job(Path(out), photos, exemplar, panel, config, device, seed, quiet)
    with warmup or Warmup(("reconstruct", "transfer", "stylize", "encode")) as job.warmup:
        return job.run()


class _Job:
    """One run of the main job: inputs, folder, and the stages as methods."""

    def __init__(self, out: Path, photos: Path | Capture, exemplar: Exemplar, display: Display,
                 config: MakeConfig, device: str, seed: int, quiet: bool) -> None:
        self.out, self.photos, self.exemplar, self.display = out, photos, exemplar, display
        self.config, self.seed, self.quiet = config, seed, quiet
        self.device = computing_device(device)
        self.stages = StageFolder(out, self._say)
        self.warmup: Warmup | None = None

    def _say(self, line: str) -> None:
        if not self.quiet:
            print(line, file=sys.stderr)

    @contextmanager
    def _progress(self, title: str, kernels: tuple[str, ...] = ()) -> Iterator[Progress]:
        """A stage's progress line, once the stage's kernels are there."""
        with compiling_progress(title, enabled=not self.quiet) as progress:
            if self.warmup is not None:
                self.warmup.wait(kernels, progress)
            yield progress

    def run(self) -> dict[str, Any]:
        config = self.config
        capture = capture_key(source_key(self.photos), config, self.seed)
        field = field_key(capture, config)
        style = style_key(field, config, painting_key(self.exemplar))
        code = code_key(style, config, self.display)
        share = key_of("job.summary", code, config.sweep_size, config.page)
        self.stages.run("capture", capture, ["capture"], self._capture)
        self.stages.run("reconstruct", field, ["field.npz"], self._reconstruct)
        self.stages.run("stylize", style, ["styled.npz"], self._stylize)
        self.stages.run("encode", code, ["lightfield.png"], self._encode)
        self.stages.run("share", share, ["portrait.html", "sweep.mp4", "report.html"],
                        self._share)
        run = self._figures()
        write_json(self.out / "run.json", run)
        return run

    def _figures(self) -> dict[str, Any]:
        figures = self.stages.figures
        seconds = {name: stage["stage_seconds"] for name, stage in figures.items()}
        peak = max([peak_memory_bytes(), *(int(stage.get("peak_memory_bytes", 0))
                                           for stage in figures.values())])
        return {"version": __version__, "device": self.device,
                "machine": machine(), "style": self.exemplar.name, "display": self.display.name,
                "seconds": {"total": round(sum(seconds.values()), 3), **seconds},
                "peak_memory_bytes": peak, "resumed": self.stages.resumed, **figures}

    def _capture(self) -> dict[str, Any]:
        if isinstance(self.photos, Capture):
            capture, figures = self.photos, {"source": "embedded", "views": len(self.photos)}
        else:
            with self._progress("capture") as progress:
                capture, figures = prepare_capture(
                    Path(self.photos), replace(self.config.calibrate, seed=self.seed),
                    keep_background=self.config.keep_background, need_face=True,
                    progress=progress, sheet=self.out.with_name(f"{self.out.name}-photos.jpg"))
        save_folder(capture.save, self.out / "capture")
        return figures

    def _reconstruct(self) -> dict[str, Any]:
        checkpoint = self.stages.scratch("reconstruct.npz")
        with self._progress("reconstruct", ("reconstruct",)) as progress:
            figures = write_field(self.out / "capture", self.out / "field.npz", self.config,
                                  self.seed, progress, checkpoint)
        self.stages.remove_scratch("reconstruct.npz")
        span = figures.get("geometry", {}).get("span_degrees", 360.0)
        if span < self.display.cone:
            warnings.warn(
                f"the photos go around the head by {span:.0f} degrees, {self.display.name} shows "
                f"{self.display.cone:.0f}: what its outer views show is partly a guess "
                "(report.html shows where); film from further left and right", stacklevel=2)
        return {**figures, "peak_memory_bytes": peak_memory_bytes()}

    def _stylize(self) -> dict[str, Any]:
        from ..stylize import kept_skin

        config, path = self.config.stylize, self.out / "field.npz"
        with self._progress("stylize", ("transfer", "stylize")) as progress:
            field, capture = VoxelField.load(path), Capture.load(self.out / "capture")
            skin = kept_skin(path, field, capture, config.pixels) if config.on_skin else None
            figures = write_styled(field, capture, self.exemplar, self.out / "styled.npz",
                                   self.config, self.seed, progress, device=self.device, skin=skin)
        return {**figures, "peak_memory_bytes": peak_memory_bytes()}

    def _encode(self) -> dict[str, Any]:
        styled = VoxelField.load(self.out / "styled.npz")
        with self._progress("encode", ("encode",)):
            figures = write_code(styled, self.display, self.out, "lightfield.png", self.config,
                                 device=self.device)
        return {**figures, "peak_memory_bytes": peak_memory_bytes()}

    def _share(self) -> dict[str, Any]:
        with self._progress("share") as progress:
            return share_job(self.out, self.exemplar, self.display, self.config.encode,
                             self.config.stylize.transfer, self.stages.figures,
                             parameters=self.config, page=self.config.page,
                             size=self.config.sweep_size,
                             progress=progress)
