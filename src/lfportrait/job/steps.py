"""A job's parameters, inputs, and stages as functions from files to files.

A stage is pure: what it writes follows from the files it reads, its parameters and the seed. Which
stages there are, and their keys, is in `graph`; how a task of the graph is done, in `work`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..cache import hash_of
from ..capture import CalibrateConfig, Capture
from ..example import Exemplar, Skin
from ..face import fit_to_surface, is_portrait, portrait_field
from ..field import ReconstructConfig, VoxelField, lattice_points, reconstruct_with_figures
from ..lightfield import (
    Display,
    EncodeConfig,
    Placement,
    QuiltLayout,
    ViewMask,
    composed,
    encode_with_figures,
    quilt_of,
    write_coded,
)
from ..media.folders import files_below
from ..progress import Progress
from ..share import PageConfig, write_quilt
from ..stages import fingerprint_files
from ..stylize import StylizeConfig
from .few_photos import MadeFrom

__all__ = ["MakeConfig", "fitted", "look_at", "painting_key", "source_files",
           "source_key", "write_code", "write_field", "write_styled"]

Look = Callable[[Capture, Callable[[], VoxelField]], None]
"""Is offered a field that is made in part: its capture, and what gives it."""


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


def write_field(capture: Capture, target: Path, config: MakeConfig, seed: int,
                progress: Progress | None, checkpoint: Path | None = None, *,
                device: str = "auto", look: Look | None = None,
                ) -> tuple[dict[str, Any], VoxelField]:
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
    result.save(target)
    return figures, result.as_read()


def write_styled(field: VoxelField, capture: Capture, exemplars: Sequence[Exemplar], target: Path,
                 config: MakeConfig, seed: int, progress: Progress | None, *,
                 device: str = "auto", skin: Skin | None = None,
                 ) -> tuple[dict[str, Any], VoxelField]:
    """Stylise a field by exemplars; the figures, and the field as written."""
    from ..stylize import stylize_with_figures

    styled, figures = stylize_with_figures(field, capture, exemplars,
                                           replace(config.stylize, seed=seed), progress,
                                           device=device, skin=skin)
    styled.save(target)
    return figures, styled.as_read()


def write_code(styled: VoxelField, display: Display, folder: Path, name: str, config: MakeConfig,
               *, prefix: str = "", device: str = "auto") -> dict[str, Any]:
    """Code a styled field for a display, and as a quilt.

    Parameters
    ----------
    styled, display
        What is coded, for what.
    folder, name
        Where the coded picture goes.
    config
        Parameters.
    prefix
        Begins the quilt's name; quilts of that prefix from before are removed.
    device
        Where to compute.

    Returns
    -------
    figures
        Of the coding; ``quilt`` is the quilt's file name.
    """
    encode = composed(styled, display, config.encode)
    image, figures = encode_with_figures(styled, display, encode,
                                         mask=ViewMask.build(display), device=device)
    with ThreadPoolExecutor(1) as beside:  # compressing lets go of Python's lock
        written = beside.submit(write_coded, folder / name, image, display)
        picture, quilt = quilt_of(styled, display, encode)
        written.result()
    for old in folder.glob(f"{prefix}quilt_*.png"):
        old.unlink()
    layout = QuiltLayout.of_name(quilt)
    assert layout is not None
    write_quilt(folder / f"{prefix}{quilt}", picture, layout, beside=False)
    return {**figures, "quilt": f"{prefix}{quilt}"}
