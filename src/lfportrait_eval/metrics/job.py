"""All figures of a finished job: held-out views, consistency, identity, contours, style, paint."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait import models
from lfportrait.arrays import Bool
from lfportrait.capture import Camera, Capture
from lfportrait.color import to_uint8
from lfportrait.device import device_name, torch_device
from lfportrait.errors import UserError
from lfportrait.example import Exemplar
from lfportrait.field import VoxelField, held_out_quality
from lfportrait.progress import Progress

from .features import (
    LPIPS_NETWORKS,
    exemplar_crops,
    feature_distance,
    lpips,
    spread_crops,
    style_distance,
)
from .patches import patch_fidelity
from .repeats import RowLabels, region_repeats, sharpness
from .views import Arc, Pictures, arc_cameras, identity

Wanted = Callable[[Camera, int], NDArray[Any]]
"""Cameras and a view -> what was painted seen in it, [H, W, 3], NaN where unknown."""


def without_nan(value: Any) -> Any:
    """Figures with None for what could not be measured: JSON has no NaN."""
    if isinstance(value, dict):
        return {name: without_nan(item) for name, item in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value


def evaluate_field(field: VoxelField, styled: VoxelField, exemplar: Exemplar | None = None, *,
                   cone: float = 40.0, views: int = 21, size: int = 384, crops: int = 48,
                   seed: int = 0, labels: RowLabels | None = None,
                   landmarks: NDArray[np.floating] | None = None, wanted: Wanted | None = None,
                   close: int = 768, progress: Progress | None = None,
                   device: str = "auto") -> dict[str, Any]:
    """Measure a stylised field against the real one, and against the exemplar.

    Parameters
    ----------
    field, styled : The real and the stylised field (same densities).
    exemplar : The painting; without it the distances to the style are left out.
    cone, views, size : Width in degrees of the arc for consistency, views on it, and width and
        height of the renders in pixels; identity is measured from -45 to +45.
    crops : Crops of renders and exemplar compared by Inception features.
    labels : Regions of the rows, for repeats; by default those that ``styled`` carries, if it does.
    landmarks : [68, 3] in space, for the size of the face in the views for repeats.
    wanted : What was painted, seen in a view, for the sharpness.
    close : Width and height in pixels of the renders for repeats and sharpness.

    Returns
    -------
    figures : ``device`` of the networks, ``consistency``, ``contours``, ``identity`` (if the face
        detector is at hand), ``content`` (feature distance of stylised and real views; LPIPS, too,
        if its networks are at hand), ``style`` (if an exemplar is given), ``repeats``
        (`region_repeats` at the ends and the middle of the arc, in profile and from behind; needs
        an exemplar and labels), ``sharpness`` (of the views at the ends and in the middle, and
        their ``mean``; needs ``wanted``). What could not be measured is None.
    """
    def say(text: str) -> None:
        if progress is not None:
            progress.update(progress.done, text)

    arc = Arc.of(field, cone, views, size, say)
    painted = arc.seen(styled)
    say("consistency")
    figures: dict[str, Any] = {
        "device": device_name(torch_device(device)),
        "arc": {"cone": cone, "views": views, "size": size},
        "consistency": arc.consistency(painted),
        "contours": {"gradient_correlation": arc.contours(painted)}}
    middle = views // 2
    photo = np.clip(arc.real[middle].color, 0, 1)
    figures["content"] = {
        "feature_distance": feature_distance(painted[middle], photo, arc.masks[middle],
                                             device=device)}
    if not models.missing(LPIPS_NETWORKS["vgg"]):
        figures["content"]["lpips"] = lpips(painted[middle], photo, device=device)
    if models.available("face-landmarker"):
        say("identity")
        figures["identity"] = landmarks_kept(field, styled, size)
    if exemplar is not None:
        say("style")
        figures["style"] = _style(painted, arc.masks, exemplar, crops, seed, device)
    labels = labels or RowLabels.of(styled)
    ends_and_middle = (-cone / 2, 0.0, cone / 2)
    figures["repeats"] = figures["sharpness"] = None
    if exemplar is not None and labels is not None:
        say("repeats")
        figures["repeats"] = region_repeats(styled, exemplar, labels, size=close,
                                            degrees=(*ends_and_middle, 90.0, 180.0),
                                            landmarks=landmarks)
    if wanted is not None:
        say("sharpness")
        figures["sharpness"] = _sharpness(styled, wanted, ends_and_middle, close)
    measured: dict[str, Any] = without_nan(figures)
    return measured


def landmarks_kept(field: VoxelField, styled: VoxelField, size: int = 384) -> dict[str, float]:
    """Landmarks kept from -45 to +45 degrees, by the registry's detector: figures of `identity`."""
    from lfportrait.face import detect_landmarks

    degrees = np.linspace(-45.0, 45.0, 7)
    cameras = arc_cameras(field, degrees, size)
    pairs = [tuple(to_uint8(one.render(cameras, view).color) for one in (styled, field))
             for view in range(len(degrees))]
    return identity([painted for painted, _ in pairs], [photo for _, photo in pairs],
                    detect_landmarks)


def _sharpness(styled: VoxelField, wanted: Wanted, degrees: tuple[float, ...],
               size: int) -> dict[str, float]:
    """Sharpness of views against what was painted, by yaw, and the mean of those that have any."""
    cameras = arc_cameras(styled, degrees, size)
    figures = {}
    for view, yaw in enumerate(degrees):
        shot = styled.render(cameras, view)
        figures[f"{yaw:g}"] = sharpness(shot.color, wanted(cameras, view), shot.alpha > 0.5)
    known = [value for value in figures.values() if np.isfinite(value)]
    return {**figures, "mean": float(np.mean(known)) if known else float("nan")}


def _style(painted: Pictures, masks: list[Bool], exemplar: Exemplar, crops: int,
           seed: int, device: str) -> dict[str, Any]:
    """Distances of the stylised views to the exemplar."""
    middle = len(painted) // 2
    figures: dict[str, Any] = {"patch_fidelity": patch_fidelity(
        painted[middle], exemplar.image, masks[middle], seed=seed)}
    if models.available("inception"):
        # Crops of about `CROP` of the face's width in both: a face takes 0.4 of a sweep's picture.
        ours = max(painted[middle].shape[0] // 4, 16)
        figures.update(style_distance(
            spread_crops([to_uint8(image) for image in painted], masks, ours, crops, seed),
            exemplar_crops(exemplar, crops, seed + 1), device))
    return figures


def evaluate_job(job: str | Path, exemplar: Exemplar | None = None, *,
                 progress: Progress | None = None, **options: Any) -> dict[str, Any]:
    """Measure a finished job, the folder that `lfportrait make` or `demo` wrote.

    Figures of `evaluate_field`, which is given the options, and ``test``: PSNR and SSIM of the
    held-out views of the real field.
    """
    job = Path(job)
    for name in ("capture", "field.npz", "styled.npz"):
        if not (job / name).exists():
            raise UserError(f"{job} is not a finished job: it has no {name}; run "
                            "`lfportrait make` or `lfportrait demo` first")
    field, styled = VoxelField.load(job / "field.npz"), VoxelField.load(job / "styled.npz")
    capture = Capture.load(job / "capture")
    options = {"labels": RowLabels.read(job / "styled.npz"), "landmarks": capture.landmarks,
               **options}
    figures = evaluate_field(field, styled, exemplar, progress=progress, **options)
    if len(capture.testing()):
        figures["test"] = held_out_quality(field, capture)
    return figures
