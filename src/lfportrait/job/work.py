"""The work of each stage: its files from the files of the stages before, in any process.

Nothing but the task, the folder of the results and a few tools is known here.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from .. import lightfield
from ..cache import StageFolder
from ..capture import Camera, Capture
from ..color import to_uint8
from ..errors import UserError
from ..example import Exemplar, Skin, load_skin, save_skin
from ..face import fit_to_surface, is_portrait, portrait_field
from ..field import VoxelField, reconstruct_with_figures
from ..files import write_image
from ..lightfield import Display, QuiltLayout, ViewMask, quilt_of
from ..measure import give_back_memory, peak_memory_bytes
from ..progress import Outlook, Progress
from ..share import good_cone, sweep_cameras, sweep_frames, write_page, write_quilt, write_video
from ..simd.host import compiling_progress
from ..stylize import StylizeConfig, kept_skin, load_styled
from .graph import STAGES, MakeConfig, Task
from .prepare import prepare_capture
from .warmup import Warmup

if TYPE_CHECKING:
    from .first_look import FirstLook

Look = Callable[[Capture, Callable[[], VoxelField]], None]
"""Is offered a field that is made in part: its capture, and what gives it."""

_THUMBNAIL = 192  # Height of the small pictures of an index in pixels.


@dataclass
class Tools:
    """Tools of a stage besides its task."""

    shown: bool = False  # Whether its progress is shown.
    device: str = "auto"  # Where to compute.
    warmup: Warmup | None = None  # Kernels that are being compiled beside.
    # capture, exemplar: Photos and painting that are in memory already, instead of the task's
    # source.
    capture: Capture | None = None
    exemplar: Exemplar | None = None
    report: bool = False  # Whether the report is written in this process, too.
    # Further paintings that the head is painted in, for mixes of them.
    others: Sequence[Exemplar] = ()
    # Picture of the photos that were left out; by default in the task's folder.
    sheet: Path | None = None
    look: FirstLook | None = None  # The first look that is taken while a field is made.
    outlook: Outlook | None = None  # Knows the time that is left of the whole job.
    # What a job's stages have read and written, for those after them in the same process, as these
    # would read it: ``capture``, ``field`` and ``styled``, the latter in the colors that are coded;
    # and what the report shows of the skin, ``charts``.
    kept: dict[str, Any] = field(default_factory=dict)

    @contextmanager
    def progress(self, stage: str) -> Iterator[Progress]:
        """A stage's progress line, once its kernels are there."""
        with compiling_progress(STAGES[stage].title, enabled=self.shown,
                                outlook=self.outlook) as progress:
            if self.warmup is not None:
                self.warmup.wait(STAGES[stage].kernels, progress)
            if self.outlook is not None:
                self.outlook.at(STAGES[stage].title, "start")
            yield progress

    def painting(self, task: Task) -> Exemplar:
        """The painting of a task."""
        return _exemplar(task.source) if self.exemplar is None else self.exemplar


def do_stage(task: Task, results: Path, folder: StageFolder, tools: Tools,
             figures: dict[str, dict[str, Any]] | None = None) -> dict[str, Any]:
    """Do the work of a task; its figures.

    The task's paths are relative to ``results``; ``folder`` is its own. ``figures`` are those of
    the stages before, for the report.
    """
    with tools.progress(task.stage) as progress:
        if task.stage == "share":
            from .summary import share_job

            done = share_job(task, results, tools.painting(task), figures or {}, progress,
                             kept=tools.kept)
        else:
            done = _WORK[task.stage](task, results, folder, tools, progress)
        give_back_memory()
        return {**done, "peak_memory_bytes": peak_memory_bytes(), "steps": {
            name: {"seconds": seconds, "core_seconds": cores}
            for name, (seconds, cores) in progress.costs.items()}}


def _capture(task: Task, results: Path, folder: StageFolder, tools: Tools,
             progress: Progress) -> dict[str, Any]:
    target = results / task.folder
    if tools.capture is not None:
        capture, figures = tools.capture, {"source": "embedded", "views": len(tools.capture)}
    else:
        capture, figures = prepare_capture(
            Path(task.source), replace(task.config.calibrate, seed=task.seed),
            keep_background=task.config.keep_background, need_face=True,
            made_from=task.config.made_from, progress=progress,
            sheet=tools.sheet or target / "photos-left-out.jpg")
    tools.kept["capture"] = capture.saved(target / task.outputs[0])
    for name in task.outputs[1:]:
        angle = np.abs(np.arctan2(capture.cameras.position[:, 0], capture.cameras.position[:, 2]))
        _write_thumbnail(target / name, capture.image_float(int(np.argmin(angle))))
    return figures


def _field(task: Task, results: Path, folder: StageFolder, tools: Tools,
           progress: Progress) -> dict[str, Any]:
    checkpoint = f"{task.record}.npz"
    capture = tools.kept.get("capture") or Capture.load(results / task.inputs["capture"])
    tools.kept["capture"] = capture
    figures, tools.kept["field"] = write_field(
        capture, results / task.folder / task.outputs[0], task.config, task.seed, progress,
        folder.scratch(checkpoint), device=tools.device,
        look=None if tools.look is None else functools.partial(tools.look.offer, progress))
    folder.remove_scratch(checkpoint)
    return figures


def _skin(task: Task, results: Path, folder: StageFolder, tools: Tools,
          progress: Progress) -> dict[str, Any]:
    capture = Capture.load(results / task.inputs["capture"])
    if capture.landmarks is None:
        raise UserError("the capture has no facial landmarks, which painting on the skin needs; "
                        "set stylize.method to arf")
    skin = Skin.of(VoxelField.load(results / task.inputs["field"]), capture.landmarks,
                   capture.cameras, task.config.stylize.pixels)
    save_skin(skin, results / task.folder / task.outputs[0], task.key)
    return {}


@functools.lru_cache(4)
def _exemplar(painting: str) -> Exemplar:
    """A painting, read once for the tasks of a process."""
    return Exemplar.load(painting)


def _stylize(task: Task, results: Path, folder: StageFolder, tools: Tools,
             progress: Progress) -> dict[str, Any]:
    target, config = results / task.folder, task.config.stylize
    path = results / task.inputs["field"]
    real = tools.kept.get("field") or VoxelField.load(path)
    capture = tools.kept.get("capture") or Capture.load(results / task.inputs["capture"])
    tools.kept.update(field=real, capture=capture)
    skin = None
    if config.on_skin:
        skin = (load_skin(results / task.inputs["skin"], task.skin_key)
                if "skin" in task.inputs else kept_skin(path, real, capture, config.pixels))
    figures, tools.kept["styled"] = write_styled(
        real, capture, [tools.painting(task), *tools.others], target / task.outputs[0],
        replace(config, seed=task.seed), progress, device=tools.device, skin=skin)
    if skin is not None and tools.report:
        from .summary import charts_of

        tools.kept["charts"] = charts_of(skin)
    for name in task.outputs[1:]:
        styled = load_styled(target / task.outputs[0])
        cameras: Camera = sweep_cameras(0.0, 1, _THUMBNAIL, styled)
        _write_thumbnail(target / name, styled.render(cameras, 0, background=1.0).color)
    return figures


def _encode(task: Task, results: Path, folder: StageFolder, tools: Tools,
            progress: Progress) -> dict[str, Any]:
    assert task.display is not None
    styled = tools.kept.get("styled") or VoxelField.load(results / task.inputs["styled"])
    tools.kept["styled"] = styled
    figures = write_code(styled, task.display,
                         results / task.folder, task.outputs[0], task.config,
                         prefix=f"{task.label}_" if task.label else "", device=tools.device)
    return {**figures, "more": [figures["quilt"]]}


def _page(task: Task, results: Path, folder: StageFolder, tools: Tools,
          progress: Progress) -> dict[str, Any]:
    return write_page(load_styled(results / task.inputs["styled"]),
                      results / task.folder / task.outputs[0], task.config.page,
                      task.config.encode)


def _sweep(task: Task, results: Path, folder: StageFolder, tools: Tools,
           progress: Progress) -> dict[str, Any]:
    styled = load_styled(results / task.inputs["styled"])
    cone = good_cone(styled, task.display.cone if task.display is not None else 40.0)
    write_video(results / task.folder / task.outputs[0],
                sweep_frames(styled, cone, 90, task.config.sweep_size,
                             background=task.config.encode.background,
                             ground=task.config.encode))
    return {}


def write_field(capture: Capture, target: Path, config: MakeConfig, seed: int,
                progress: Progress | None, checkpoint: Path | None = None, *, device: str = "auto",
                look: Look | None = None) -> tuple[dict[str, Any], VoxelField]:
    """Reconstruct the field of a capture; its figures, and the field as written.

    ``look`` is offered fields that are made in part, with the capture.
    """
    settings = replace(config.reconstruct, seed=seed)
    shown = None if look is None else partial(look, capture)
    if is_portrait(capture):
        result, figures = portrait_field(capture, settings, progress, look=shown)
    else:
        result, figures = reconstruct_with_figures(
            capture, settings, progress, checkpoint=checkpoint, device=device, look=shown,
            fit_head=fit_to_surface)
        if capture.landmarks is not None and capture.alphas is not None:
            say_poor(figures)
    result.save(target)
    return figures, result.as_read()


def say_poor(figures: dict[str, Any]) -> None:
    """Warn of a head that is far from the photos which were held out."""
    test = figures.get("test", {})
    met = test.get("psnr_kept", test.get("psnr", POOR))
    if met < POOR:
        warnings.warn(f"photos that were held out are met with {met:.0f} dB only (30 are usual): "
                      "the person moved, or the cameras are wrong; see report.html; of photos "
                      "without cameras --from face takes the best one", stacklevel=2)


POOR = 20.0  # PSNR in dB of held-out photos below which a field is of no use.


def write_styled(field: VoxelField, capture: Capture, exemplars: Sequence[Exemplar], target: Path,
                 config: StylizeConfig, progress: Progress | None, *, device: str = "auto",
                 skin: Skin | None = None) -> tuple[dict[str, Any], VoxelField]:
    """Stylise a field by exemplars; the figures, and the field as written."""
    from ..stylize import stylize_with_figures

    styled, figures = stylize_with_figures(field, capture, exemplars, config, progress,
                                           device=device, skin=skin)
    styled.save(target)
    return figures, styled.as_read()


def write_code(styled: VoxelField, display: Display, folder: Path, name: str, config: MakeConfig,
               *, prefix: str = "", device: str = "auto") -> dict[str, Any]:
    """Code a styled field for a display, and as a quilt; figures.

    Among them is ``quilt``, the quilt's file name. ``prefix`` begins the quilt's name; quilts of
    that prefix from before are removed.
    """
    encode = lightfield.composed(styled, display, config.encode)
    image, figures = lightfield.encode_with_figures(styled, display, encode,
                                                    mask=ViewMask.build(display), device=device)
    with ThreadPoolExecutor(1) as beside:  # compressing lets go of Python's lock
        written = beside.submit(lightfield.write_coded, folder / name, image, display)
        picture, quilt = quilt_of(styled, display, encode)
        written.result()
    for old in folder.glob(f"{prefix}quilt_*.png"):
        old.unlink()
    layout = QuiltLayout.of_name(quilt)
    assert layout is not None
    write_quilt(folder / f"{prefix}{quilt}", picture, layout, beside=False)
    return {**figures, "quilt": f"{prefix}{quilt}"}


def _write_thumbnail(path: Path, image: Any) -> None:
    """A small JPEG of a picture, [H, W, 3] floats in [0, 1]."""
    pixels = to_uint8(image)
    width = max(1, round(pixels.shape[1] * _THUMBNAIL / pixels.shape[0]))
    small = Image.fromarray(pixels).resize((width, _THUMBNAIL), Image.Resampling.LANCZOS)
    write_image(path, np.asarray(small), quality=85)


_WORK: dict[str, Callable[[Task, Path, StageFolder, Tools, Progress], dict[str, Any]]] = {
    "capture": _capture, "field": _field, "skin": _skin, "stylize": _stylize, "encode": _encode,
    "page": _page, "sweep": _sweep}
