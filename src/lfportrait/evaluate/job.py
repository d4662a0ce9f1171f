"""All figures of a finished job: held-out views, consistency, identity, contours, style."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import models
from ..capture import Camera, Capture
from ..errors import UserError
from ..example import Exemplar
from ..field import Rendering, VoxelField, held_out_quality
from ..progress import Progress
from ..share import sweep_cameras
from .consistency import consistency
from .features import LPIPS_NETWORKS, feature_distance, lpips, style_distance
from .likeness import contour_correlation, identity
from .patches import patch_fidelity

__all__ = ["evaluate_field", "evaluate_job"]

Pictures = list[NDArray[np.float32]]


def _bytes(image: NDArray[np.floating]) -> NDArray[np.uint8]:
    return (np.clip(image, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def _known(value: Any) -> Any:
    """Figures with None for what could not be measured: JSON has no NaN."""
    if isinstance(value, dict):
        return {name: _known(item) for name, item in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _arc(field: VoxelField, degrees: NDArray[np.float64], size: int) -> Camera:
    """Cameras at the given yaws, framed like a sweep."""
    front = sweep_cameras(0.0, 1, size, field)
    # A sweep's cameras differ in yaw alone: turn the frontal one about the vertical axis.
    poses = []
    for yaw in np.radians(degrees):
        turn = np.eye(4)
        turn[0, 0] = turn[2, 2] = np.cos(yaw)
        turn[0, 2], turn[2, 0] = np.sin(yaw), -np.sin(yaw)
        poses.append(turn @ front.pose[0])
    return Camera(np.array(poses), front.focal[0], front.center[0], front.width[0],
                  front.height[0])


def _crops(pictures: list[NDArray[np.uint8]], masks: list[NDArray[np.bool_]], size: int,
           count: int, seed: int) -> list[NDArray[np.uint8]]:
    """Square crops whose middles lie where the masks are set, spread evenly over the pictures."""
    generator = np.random.default_rng(seed)
    crops = []
    for index in range(count):
        picture, mask = pictures[index % len(pictures)], masks[index % len(pictures)]
        height, width = picture.shape[:2]
        side = min(size, height, width)
        rows, columns = np.nonzero(mask)
        if not len(rows):
            continue
        pick = generator.integers(len(rows))
        y = int(np.clip(rows[pick] - side // 2, 0, height - side))
        x = int(np.clip(columns[pick] - side // 2, 0, width - side))
        crops.append(picture[y:y + side, x:x + side])
    return crops


def evaluate_field(field: VoxelField, styled: VoxelField, exemplar: Exemplar | None = None, *,
                   cone: float = 40.0, views: int = 21, size: int = 384, crops: int = 48,
                   seed: int = 0, progress: Progress | None = None) -> dict[str, Any]:
    """Measure a stylised field against the real one, and against the exemplar.

    Parameters
    ----------
    field, styled
        The real and the stylised field (same densities).
    exemplar
        The painting; without it the distances to the style are left out.
    cone
        Width in degrees of the arc for consistency; identity is measured from -45 to +45.
    views
        Views on that arc.
    size
        Width and height of the renders in pixels.
    crops
        Crops of renders and exemplar compared by Inception features.
    seed
        Seed of the samples.
    progress
        Progress line.

    Returns
    -------
    figures
        ``consistency``, ``contours``, ``identity`` (if the face detector is at hand), ``content``
        (feature distance of stylised and real views; LPIPS, too, if its networks are at hand),
        ``style`` (if an exemplar is given). What could not be measured is None.
    """
    def say(text: str) -> None:
        if progress is not None:
            progress.update(progress.done, text)

    degrees = np.linspace(-cone / 2, cone / 2, views)
    cameras = _arc(field, degrees, size)
    real: list[Rendering] = []
    painted: Pictures = []
    for view in range(views):
        say(f"view {view + 1} of {views}")
        real.append(field.render(cameras, view))
        painted.append(np.clip(styled.render(cameras, view).color, 0, 1))
    say("consistency")
    figures: dict[str, Any] = {
        "arc": {"cone": cone, "views": views, "size": size},
        "consistency": consistency(painted, real, cameras)}
    middle = views // 2
    inside = real[middle].alpha > 0.5
    photo = np.clip(real[middle].color, 0, 1)
    figures["contours"] = {
        "gradient_correlation": contour_correlation(painted[middle], photo, inside)}
    figures["content"] = {"feature_distance": feature_distance(painted[middle], photo, inside)}
    if not models.missing(LPIPS_NETWORKS):
        figures["content"]["lpips"] = lpips(painted[middle], photo)
    if models.available("face-landmarker"):
        say("identity")
        figures["identity"] = _identity(field, styled, size)
    if exemplar is not None:
        say("style")
        figures["style"] = _style(painted, [r.alpha > 0.5 for r in real], exemplar, crops, seed)
    measured: dict[str, Any] = _known(figures)
    return measured


def _identity(field: VoxelField, styled: VoxelField, size: int) -> dict[str, Any]:
    """Landmarks kept from -45 to +45 degrees, by the registry's detector."""
    from ..face import detect_landmarks

    degrees = np.linspace(-45.0, 45.0, 7)
    cameras = _arc(field, degrees, size)
    pairs = [tuple(_bytes(one.render(cameras, view).color) for one in (styled, field))
             for view in range(len(degrees))]
    return identity([painted for painted, _ in pairs], [photo for _, photo in pairs],
                    detect_landmarks)


def _style(painted: Pictures, masks: list[NDArray[np.bool_]], exemplar: Exemplar, crops: int,
           seed: int) -> dict[str, Any]:
    """Distances of the stylised views to the exemplar."""
    middle = len(painted) // 2
    figures: dict[str, Any] = {"patch_fidelity": patch_fidelity(
        painted[middle], exemplar.image, masks[middle], seed=seed)}
    if models.available("inception"):
        mask = (np.ones(exemplar.image.shape[:2], bool) if exemplar.mask is None
                else exemplar.mask > 0.5)
        if exemplar.mask is None:
            low, high = exemplar.landmarks.min(axis=0), exemplar.landmarks.max(axis=0)
            mask[:] = False
            mask[max(int(low[1]), 0):int(high[1]) + 1, max(int(low[0]), 0):int(high[0]) + 1] = True
        # Crops of about 0.6 of the face's width in both: a face takes 0.4 of a sweep's picture.
        ours = max(painted[middle].shape[0] // 4, 16)
        theirs = max(int(0.6 * float(np.ptp(exemplar.landmarks[:, 0]))), 16)
        figures.update(style_distance(
            _crops([_bytes(image) for image in painted], masks, ours, crops, seed),
            _crops([exemplar.image], [mask], theirs, crops, seed + 1)))
    return figures


def evaluate_job(job: str | Path, exemplar: Exemplar | None = None, *,
                 progress: Progress | None = None, **options: Any) -> dict[str, Any]:
    """Measure a finished job.

    Parameters
    ----------
    job
        Folder that `lfportrait make` or `demo` wrote.
    exemplar
        The job's exemplar, for the distances to the style.
    progress
        Progress line.
    options
        Passed on to `evaluate_field`.

    Returns
    -------
    figures
        Those of `evaluate_field`, and ``test``: PSNR and SSIM of the held-out views of the real
        field.

    Raises
    ------
    UserError
        If the folder is not a finished job.
    """
    job = Path(job)
    for name in ("capture", "field.npz", "styled.npz"):
        if not (job / name).exists():
            raise UserError(f"{job} is not a finished job: it has no {name}; run "
                            "`lfportrait make` or `lfportrait demo` first")
    field, styled = VoxelField.load(job / "field.npz"), VoxelField.load(job / "styled.npz")
    figures = evaluate_field(field, styled, exemplar, progress=progress, **options)
    capture = Capture.load(job / "capture")
    if len(capture.testing()):
        figures["test"] = held_out_quality(field, capture)
    return figures
