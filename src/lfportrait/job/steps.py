"""A job's parameters, inputs, and stages as functions from files to files.

A stage is pure: what it writes follows from the files it reads, its parameters and the seed. Which
stages there are, and their keys, is in `graph`; how a task of the graph is done, in `work`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..cache import hash_of
from ..capture import CalibrateConfig, Capture
from ..example import Exemplar
from ..field import ReconstructConfig, lattice_points
from ..lightfield import (
    Display,
    EncodeConfig,
    Placement,
)
from ..media.folders import files_below
from ..share import PageConfig
from ..stages import fingerprint_files
from ..stylize import StylizeConfig
from .few_photos import MadeFrom


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
    face for one photo or two, and for up to nine that can't be placed together."""
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
