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

import json
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import models
from ..capture import (
    CalibrateConfig,
    Capture,
    PhotosError,
    calibrate,
    follow_head,
    is_calibrated,
    portrait_frame_from_landmarks,
)
from ..device import computing_device
from ..errors import UserError
from ..example import Exemplar
from ..field import VoxelField
from ..files import write_json
from ..keys import kept_arrays, key_of
from ..lanes.compiling import compiling_progress
from ..lightfield import Display
from ..measure import machine, peak_memory_bytes
from ..progress import Progress
from ..stages import StageFolder, check_writable
from ..version import __version__
from .networks import get_networks
from .person import cut_person, rough_mattes
from .photo_check import problem_sheet
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

__all__ = ["MakeConfig", "make", "prepare_capture"]


def _with_landmarks(capture: Capture, reframe: bool, progress: Progress | None,
                    ) -> tuple[Capture, dict[str, Any]]:
    """The capture with the face's landmarks, and in its frame if it may be moved; figures.

    Those of a calibrated data set are kept in the user's cache, as each command looks for them.
    """
    points, figures = (_landmarks(capture, progress) if reframe
                       else _kept_landmarks(capture, progress))
    if points is None:
        return capture, figures
    if reframe:
        similarity = portrait_frame_from_landmarks(points, capture.cameras)
        points = points @ similarity[:3, :3].T + similarity[:3, 3]
        capture = capture.reframed(similarity)
    return replace(capture, landmarks=points), figures


def _landmarks(capture: Capture, progress: Progress | None,
               ) -> tuple[NDArray[np.float64] | None, dict[str, Any]]:
    from ..face import landmarks_of_capture

    return landmarks_of_capture(capture, progress)


def _kept_landmarks(capture: Capture, progress: Progress | None,
                    ) -> tuple[NDArray[np.float64] | None, dict[str, Any]]:
    from ..face import detectors_key

    def find() -> dict[str, NDArray[Any]]:
        points, figures = _landmarks(capture, progress)
        return {"figures": np.array(json.dumps(figures)),
                **({} if points is None else {"points": points})}

    cameras = capture.cameras
    key = key_of(capture.images, capture.alphas, cameras.pose, cameras.focal, cameras.center,
                 detectors_key())
    kept = kept_arrays("landmarks", key, find)
    return kept.get("points"), json.loads(str(kept["figures"]))


def _following(capture: Capture, soft: list[NDArray[np.float32]], config: CalibrateConfig,
               progress: Progress | None,
               ) -> tuple[Capture, list[NDArray[np.float32]], dict[str, Any]]:
    """The capture and its rough mattes, its cameras following a head that moved; figures."""
    if progress is not None:
        progress.update(0, "looking whether the head moved")
    followed, motion = follow_head(capture, soft, config.seed,
                                   None if progress is None else progress.say)
    figures = {"moved": motion.moved, "followed": bool(motion.followed),
               "pixels": motion.pixels if np.isfinite(motion.pixels) else None,
               "pixels_after": motion.after if np.isfinite(motion.after) else None,
               "degrees": motion.degrees,
               "left_out": [name for name in capture.names if name not in followed.names]}
    if not motion.followed:
        return capture, soft, figures
    return followed, [soft[view] for view in motion.followed], figures


def _tell_left_out(figures: dict[str, Any], photos: Path, config: CalibrateConfig,
                   sheet: Path | None) -> None:
    """Warn of the photos that following the head leaves out, and mark them, too."""
    left_out = figures["head_motion"]["left_out"]
    if not left_out:
        return
    where = ""
    if sheet is not None:
        marks = _marks(figures["calibration"]) | dict.fromkeys(left_out, "head not seen")
        problem_sheet(photos, marks, sheet, config.video_frames)
        where = f"; which: {sheet}"
    warnings.warn(f"{len(left_out)} photos show too little of the head, which moved, and are left "
                  f"out: {', '.join(left_out)}{where}", stacklevel=2)


def _marks(calibration: dict[str, Any]) -> dict[str, str]:
    """What is wrong with the photos that calibration leaves out, by their names."""
    return (dict.fromkeys(calibration["blurred"], "blurred")
            | dict.fromkeys(calibration["left_out"], "not placed"))


def prepare_capture(photos: Path, config: CalibrateConfig, *, keep_background: bool = False,
                    need_face: bool = False, progress: Progress | None = None,
                    sheet: Path | None = None) -> tuple[Capture, dict[str, Any]]:
    """Photos, a video or a calibrated data set -> a capture in the portrait frame.

    Finds the cameras where there are none, the landmarks of the face in 3D and, for photos without
    an alpha channel, the person's mattes.

    Parameters
    ----------
    photos
        Folder, video file or data set.
    config
        Calibration.
    keep_background
        Keep the room behind the person.
    need_face
        Raise `UserError` where no face is found, instead of going on without landmarks.
    progress
        Progress line.
    sheet
        File for a contact sheet, written where photos are left out or can't be placed: which.

    Returns
    -------
    capture, figures
        The capture and the run's figures: views, how they were calibrated, landmark errors.
    """
    photos = Path(photos)
    if not photos.exists():
        raise UserError(f"there is no folder or file {photos}; name the folder of your photos")
    if is_calibrated(photos):
        capture = Capture.load(photos)
        figures: dict[str, Any] = {"source": "calibrated"}
        fresh = False
    else:
        try:
            capture = calibrate(photos, config, progress)
        except PhotosError as error:
            if sheet is not None:
                problem_sheet(photos, error.marks, sheet, config.video_frames)
                raise UserError(f"{error}; which photos: {sheet}") from error
            raise
        figures = {"source": "photos", "calibration": capture.figures}
        marks = _marks(capture.figures)
        if marks and sheet is not None:
            problem_sheet(photos, marks, sheet, config.video_frames)
            warnings.warn(f"which photos are left out: {sheet}", stacklevel=2)
        fresh = True
    if capture.landmarks is None:
        capture, figures["landmarks"] = _with_landmarks(capture, fresh, progress)
        if capture.landmarks is None and need_face:
            raise UserError(f"no face was found in the photos of {photos}; a portrait needs a few "
                            "photos that show the face from the front, upright and in focus")
    if capture.alphas is None and not keep_background:
        soft = rough_mattes(capture, progress)
        if fresh:
            capture, soft, figures["head_motion"] = _following(capture, soft, config, progress)
            if figures["head_motion"]["followed"]:
                capture, figures["landmarks"] = _with_landmarks(capture, fresh, progress)
            _tell_left_out(figures, photos, config, sheet)
        capture, figures["mattes"] = cut_person(capture, progress, soft=soft)
    figures["views"] = len(capture)
    figures["held_out"] = int(capture.held_out.sum())
    return capture, figures


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
        share = key_of("share", code, config.sweep_size, config.page)
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
