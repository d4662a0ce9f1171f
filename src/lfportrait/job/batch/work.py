"""A task done, in whatever process: its stage's files from the files of the stages before.

Nothing but the task and the folder of the results is known here. A task that is done from the same
inputs is not done again, so one that is given out twice, because word of it was lost, is no harm.
"""

from __future__ import annotations

import errno
import functools
import os
import socket
import traceback
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ...capture import Camera, Capture
from ...errors import UserError
from ...example import Exemplar
from ...example.skin import load_skin, save_skin
from ...field import VoxelField
from ...files import write_image
from ...measure import cost_of
from ...share import sweep_cameras, sweep_frames, write_page, write_video
from ...stages import StageFolder
from ...stylize import load_styled
from ..prepare import prepare_capture
from ..steps import save_folder, write_code, write_field, write_styled
from .plan import Task, finished

__all__ = ["Outcome", "do_task"]

_THUMBNAIL = 192
"""Height of the small pictures of the index in pixels."""


@dataclass(frozen=True)
class Outcome:
    """How a task ended.

    Attributes
    ----------
    task
        Its name.
    error
        Why it failed, in one line; empty where it is done.
    figures
        Of the stage, with ``cost``: seconds, core-seconds, peak memory, bytes written.
    fault
        The traceback, where the failure is not the user's to mend.
    worker
        Machine and process that did it.
    again
        Whether it had been done before.
    """

    task: str
    error: str = ""
    figures: dict[str, Any] | None = None
    fault: str = ""
    worker: str = ""
    again: bool = False


def do_task(task: Task, results: Path) -> Outcome:
    """Do a task.

    Parameters
    ----------
    task
        What to do.
    results
        Folder of all results.

    Returns
    -------
    outcome
        Failures of any kind are told in it; none is raised.
    """
    worker = f"{socket.gethostname()}:{os.getpid()}"
    before = finished(task, results)
    if before is not None:
        return Outcome(task.name, figures=before, worker=worker, again=True)
    try:
        figures = _done(task, results)
    except UserError as error:
        return Outcome(task.name, " ".join(str(error).split()), worker=worker)
    except MemoryError:
        return Outcome(task.name, "out of memory: let fewer tasks run at once (--workers), or make "
                       "the field smaller (reconstruct.max_voxels)", worker=worker)
    except Exception as error:
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            return Outcome(task.name, f"no space left on the disk of {results}; free some and run "
                           "the same command again", worker=worker)
        return Outcome(task.name, f"a fault of ours: {type(error).__name__}: "
                       f"{' '.join(str(error).split())}", fault=traceback.format_exc(),
                       worker=worker)
    return Outcome(task.name, figures=figures, worker=worker)


def _done(task: Task, results: Path) -> dict[str, Any]:
    """Do the stage's work, and what it told, cost and wrote."""
    folder = StageFolder(results / task.folder)

    def work() -> dict[str, Any]:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("ignore")
            warnings.filterwarnings("always", category=UserWarning, module=r"lfportrait\.")
            cost, figures = cost_of(lambda: _STAGES[task.stage](task, results, folder))
        written = sum(_size(folder.folder / name)
                      for name in (*task.outputs, *figures.get("more", ())))
        notes = list(dict.fromkeys(" ".join(str(one.message).split()) for one in told))
        return {**figures, "notes": notes, "cost": {**asdict(cost), "bytes": written}}

    return folder.run(task.record, task.key, task.outputs, work)


def _size(path: Path) -> int:
    """Bytes of a file, or of a folder's files."""
    if path.is_dir():
        return sum(one.stat().st_size for one in path.rglob("*") if one.is_file())
    return path.stat().st_size


def _capture(task: Task, results: Path, folder: StageFolder) -> dict[str, Any]:
    target = results / task.folder
    capture, figures = prepare_capture(
        Path(task.source), replace(task.config.calibrate, seed=task.seed),
        keep_background=task.config.keep_background, need_face=True,
        sheet=target / "photos-left-out.jpg")
    save_folder(capture.save, target / "capture")
    angle = np.abs(np.arctan2(capture.cameras.position[:, 0], capture.cameras.position[:, 2]))
    _write_thumbnail(target / "photo.jpg", capture.image_float(int(np.argmin(angle))))
    return figures


def _field(task: Task, results: Path, folder: StageFolder) -> dict[str, Any]:
    target = results / task.folder
    figures = write_field(target / "capture", target / "field.npz", task.config, task.seed, None,
                          folder.scratch("field.npz"))
    folder.remove_scratch("field.npz")
    return figures


def _skin(task: Task, results: Path, folder: StageFolder) -> dict[str, Any]:
    from ...example import Skin

    target = results / task.folder
    capture = Capture.load(target / "capture")
    if capture.landmarks is None:
        raise UserError("the capture has no facial landmarks, which painting on the skin needs; "
                        "set stylize.method to arf")
    skin = Skin.of(VoxelField.load(target / "field.npz"), capture.landmarks, capture.cameras,
                   task.config.stylize.pixels)
    save_skin(skin, target / task.outputs[0], task.key)
    return {}


@functools.lru_cache(4)
def _exemplar(painting: str) -> Exemplar:
    """A painting, read once for the tasks of a process."""
    return Exemplar.load(painting)


def _stylize(task: Task, results: Path, folder: StageFolder) -> dict[str, Any]:
    sitter, target = results / task.sitter, results / task.folder
    skin = None
    if task.config.stylize.on_skin:
        file = f"skin-{task.config.stylize.pixels:g}"
        skin = load_skin(sitter / f"{file}.npz", task.skin_key)
    figures = write_styled(VoxelField.load(sitter / "field.npz"), Capture.load(sitter / "capture"),
                           _exemplar(task.source), target / "styled.npz", task.config, task.seed,
                           None, skin=skin)
    styled = load_styled(target / "styled.npz")
    cameras: Camera = sweep_cameras(0.0, 1, _THUMBNAIL, styled)
    _write_thumbnail(target / "thumbnail.jpg", styled.render(cameras, 0, background=1.0).color)
    return figures


def _encode(task: Task, results: Path, folder: StageFolder) -> dict[str, Any]:
    assert task.display is not None
    target = results / task.folder
    figures = write_code(VoxelField.load(target / "styled.npz"), task.display, target,
                         task.outputs[0], task.config, prefix=f"{task.label}_")
    return {**figures, "more": [figures["quilt"]]}


def _page(task: Task, results: Path, folder: StageFolder) -> dict[str, Any]:
    target = results / task.folder
    return write_page(load_styled(target / "styled.npz"), target / task.outputs[0],
                      task.config.page)


def _sweep(task: Task, results: Path, folder: StageFolder) -> dict[str, Any]:
    target = results / task.folder
    styled = load_styled(target / "styled.npz")
    cone = task.display.cone if task.display is not None else 40.0
    write_video(target / task.outputs[0],
                sweep_frames(styled, cone, 90, task.config.sweep_size,
                             background=task.config.encode.background))
    return {}


def _write_thumbnail(path: Path, image: Any) -> None:
    """A small JPEG of a picture, [H, W, 3] floats in [0, 1]."""
    pixels = (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)
    width = max(1, round(pixels.shape[1] * _THUMBNAIL / pixels.shape[0]))
    small = Image.fromarray(pixels).resize((width, _THUMBNAIL), Image.Resampling.LANCZOS)
    write_image(path, np.asarray(small), quality=85)


_STAGES: dict[str, Callable[[Task, Path, StageFolder], dict[str, Any]]] = {
    "capture": _capture, "field": _field, "skin": _skin, "stylize": _stylize, "encode": _encode,
    "page": _page, "sweep": _sweep}
