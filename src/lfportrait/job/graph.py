"""A job as a graph: its parameters, and stages with their inputs, outputs, keys and costs.

There is one definition of each stage (`STAGES`): its name, the line that people see, the kernels
that it waits for, and what it takes. A stage is pure: what it writes follows from the files it
reads, its parameters and the seed. How a task is done is in `work`.

`lfportrait make` is one portrait's tasks in its own process (`pipeline`), a batch is those of many
on many processes or machines (`batch`); an app that shows how far a portrait is asks the same plan.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import models
from ..cache import fingerprint_files, hash_of, key_of
from ..capture import CalibrateConfig, Capture
from ..example import Exemplar
from ..field import ReconstructConfig, lattice_points
from ..lightfield import Display, EncodeConfig, Placement
from ..media.folders import files_below
from ..runner import Need, scheduler
from ..share import PageConfig
from ..stylize import StylizeConfig
from .made_from import MadeFrom


@dataclass(frozen=True)
class MakeConfig:
    """Parameters of every stage of the main job."""

    calibrate: CalibrateConfig = field(default_factory=CalibrateConfig)
    """Cameras from photos."""
    reconstruct: ReconstructConfig = field(default_factory=ReconstructConfig)
    """Radiance field."""
    stylize: StylizeConfig = field(default_factory=StylizeConfig)
    """Style transfer and the optimisation of the field."""
    encode: EncodeConfig = field(default_factory=lambda: EncodeConfig(compose=True))
    """Light-field coding."""
    page: PageConfig = field(default_factory=PageConfig)
    """The page of the portrait, ``portrait.html``."""
    made_from: MadeFrom = "auto"
    """Fit a head to the face (face), or find cameras by what the photos share (photos); auto: the
    face for one photo or two, for up to nine that can't be placed together, and for the best of
    many pictures, or of a video, where the face moves or is seen from one side only."""
    keep_background: bool = False
    """Do not cut the person out of photos that have no alpha channel."""
    sweep_size: int = 512
    """Height of the sweep video in pixels."""


def fitted(config: MakeConfig, shown: Iterable[tuple[Display, EncodeConfig]]) -> MakeConfig:
    """The same with a lattice no finer than the finest of some displays shows a head.

    All later stages pay for each voxel; photos show more than most displays do.
    """
    points = [lattice_points(Placement.of(display, encode).pixel(display))
              for display, encode in shown]
    at_most = min(config.reconstruct.max_resolution, max(points, default=256))
    return replace(config, reconstruct=replace(config.reconstruct, max_resolution=at_most))


def source_files(photos: Path) -> list[Path]:
    """The files that a capture is made from, for its fingerprint."""
    if photos.is_file():
        return [photos]
    return files_below(photos)


def source_key(photos: Path | Capture) -> str:
    """Hash of photos' names and contents, or of a capture in memory."""
    if isinstance(photos, Capture):
        return hash_of(photos.images, photos.alphas, photos.cameras.pose)
    return fingerprint_files(source_files(Path(photos)))


def painting_key(exemplar: Exemplar) -> tuple[str, str]:
    """Hashes of an exemplar's picture, and of what is known of it, shared by all sitters."""
    image, known = hashlib.sha256(), hashlib.sha256()
    image.update(np.ascontiguousarray(exemplar.image).tobytes())
    for part in (exemplar.landmarks, exemplar.mask, exemplar.by_hand):
        if part is not None:
            known.update(np.ascontiguousarray(part).tobytes())
    return image.hexdigest(), known.hexdigest()


def look_at(photos: Path) -> None:
    """Raise `UserError` if there are no photos."""
    from ..capture import is_calibrated, is_video, picture_files

    if not (is_calibrated(photos) or is_video(photos)):
        picture_files(photos, say=False)


_MB = 1_000_000


@dataclass(frozen=True)
class Stage:
    """A kind of tasks."""

    title: str  # What people see while it runs.
    # What it takes on one core, before any task of it was measured: on the demo's head at its full
    # size, on a 4K panel, and rounded up.
    need: Need
    kernels: tuple[str, ...] = ()  # What of `Warmup` it waits for.


STAGES = {
    "capture": Stage("capture", Need(2.0, 300 * _MB, 7 * _MB)),
    "field": Stage("reconstruct", Need(68.0, 1200 * _MB, 54 * _MB),
                   ("reconstruct",)),
    "skin": Stage("surface", Need(12.0, 1100 * _MB, 17 * _MB),
                  ("transfer",)),
    "stylize": Stage("stylize", Need(39.0, 2100 * _MB, 27 * _MB),
                     ("transfer", "stylize")),
    "encode": Stage("encode", Need(12.0, 1600 * _MB, 6 * _MB),
                    ("encode",)),
    "page": Stage("page", Need(6.0, 1600 * _MB, 5 * _MB)),
    "sweep": Stage("sweep", Need(29.0, 1600 * _MB, 1 * _MB)),
    "share": Stage("share", Need(40.0, 2000 * _MB, 12 * _MB)),
}
"""By name, in the order of the work; ``share`` is page, sweep and report together."""


def stage_key(stage: str, *parts: Any) -> str:
    """Key of what a stage makes from ``parts``: parameters and the keys of what it reads."""
    return key_of(__name__, stage, *parts)


def capture_key(source: str, config: MakeConfig, seed: int) -> str:
    """Key of a capture made from files with the hash ``source``."""
    return stage_key("capture", source, config.calibrate, config.keep_background,
                     config.made_from, seed)


def field_key(capture: str, config: MakeConfig) -> str:
    """Key of the field of a capture with the key ``capture``."""
    return stage_key("field", capture, config.reconstruct,
                     models.in_use(["head", "hair-segmentation"]))


def skin_key(field: str, pixels: float) -> str:
    """Key of the surface of the field with the key ``field``, at a resolution."""
    return stage_key("skin", field, pixels)


def style_key(field: str, config: MakeConfig, painting: tuple[str, str]) -> str:
    """Key of the field with the key ``field``, stylised by an exemplar (`painting_key`)."""
    return key_of(config.stylize.maker, field, config.stylize, *painting)


def code_key(style: str, config: MakeConfig, display: Display) -> str:
    """Key of the styled field with the key ``style``, coded for a display."""
    return stage_key("encode", style, config.encode, display)


def _ground(config: MakeConfig) -> tuple[object, ...]:
    """What the ground of page and sweep depends on."""
    shown = config.encode
    return shown.background, shown.ground, shown.ground_depth, shown.shadow


def page_key(style: str, config: MakeConfig) -> str:
    """Key of its page."""
    return stage_key("page", style, config.page, *_ground(config))


def sweep_key(style: str, config: MakeConfig, display: Display | None) -> str:
    """Key of its sweep over a display's cone."""
    return stage_key("sweep", style, config.sweep_size, display and display.cone, *_ground(config))


def share_key(code: str, config: MakeConfig) -> str:
    """Key of page, sweep and report of what is coded with the key ``code``."""
    return stage_key("share", code, config.sweep_size, config.page)


@dataclass(frozen=True)
class Task(scheduler.Task):
    """One stage of one portrait; named ``STAGE``, ``SITTER/STAGE`` or ``SITTER/STYLE/STAGE``."""

    # config, seed: Parameters.
    config: MakeConfig
    seed: int
    # What it reads, by kind (capture, field, skin, styled), relative to the results.
    inputs: dict[str, str] = field(default_factory=dict)
    source: str = ""  # What it reads that no task makes: photos, painting.
    display: Display | None = None  # What is coded for; the sweep's angle is its, too.
    skin_key: str = ""  # Key of the skin that is painted; empty where none is.
    label: str = ""  # What the file calls it: style, display, file name.
    device: str = "auto"  # Where to compute, a choice of ``--device``; no part of the key.

    @property
    def sitter(self) -> str:
        """Whose portrait it is."""
        return self.name.partition("/")[0]


_WORK = {"capture": ("capture", ("capture",)), "reconstruct": ("field", ("field.npz",)),
         "stylize": ("stylize", ("styled.npz",)), "encode": ("encode", ("lightfield.png",)),
         "share": ("share", ("portrait.html", "sweep.mp4", "report.html"))}
"""The tasks of one portrait, in order: the stage and the files of each."""


def portrait_tasks(keys: Mapping[str, str], config: MakeConfig, seed: int = 0, *,
                   folders: Mapping[str, str] | None = None, **more: Any) -> list[Task]:
    """The tasks of one portrait, as `lfportrait make` and the studio do them.

    Those of which ``keys`` are given: some of capture, reconstruct, stylize, encode and share.
    ``folders`` says where each writes, relative to the results, where that is not their folder
    itself; ``more`` are further arguments of all tasks.
    """
    names = [name for name in _WORK if name in keys]
    return [Task(name, _WORK[name][0], (folders or {}).get(name, ""), _WORK[name][1], keys[name],
                 tuple(names[:place]), config, seed, **more) for place, name in enumerate(names)]


class Scale(NamedTuple):
    """How large the demo is."""

    size: int
    """Width and height of the capture's pictures in pixels."""
    views: int
    """Number of cameras."""
    exemplar: int
    """Height of the painting in pixels; it is three quarters as wide."""
    display: str
    """Preset of the display."""
    config: MakeConfig
    """Parameters of the stages, with the embedded networks."""


FULL = Scale(384, 60, 1024, "generic-4k", MakeConfig(
    reconstruct=ReconstructConfig(resolutions=(64, 128, 256), rays=(0.5, 2.5, 6.0)),
    stylize=StylizeConfig(content_network="embedded", style_network="embedded")))
QUICK = Scale(256, 32, 768, "generic-1080p", MakeConfig(
    reconstruct=ReconstructConfig(resolutions=(80, 160), rays=(0.4, 1.4)),
    stylize=StylizeConfig(pixels=256.0, steps=7, content_network="embedded",
                          style_network="embedded"),
    sweep_size=384))
