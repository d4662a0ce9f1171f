"""The figures of one cell: a method's views of one sitter in one style, measured.

A figure that can't be measured is None, and `missing_networks` says which weights it waits for. No
other network stands in for them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from PIL import Image
from scipy import ndimage

from lfportrait import models
from lfportrait.arrays import Bool, Float32, Float64, UInt8
from lfportrait.capture import Camera, Capture
from lfportrait.color import to_uint8
from lfportrait.example import Exemplar
from lfportrait.face import detect_landmarks
from lfportrait.field import Rendering, VoxelField
from lfportrait.metrics import psnr, ssim
from lfportrait.stylize import row_labels

from ..metrics.features import (
    CROP,
    LPIPS_NETWORKS,
    exemplar_crops,
    feature_distance,
    frechet_distance,
    inception_features,
    kernel_distance,
    lpips,
    spread_crops,
)
from ..metrics.patches import PatchIndex
from ..metrics.repeats import (
    MARGIN,
    Repeat,
    RowLabels,
    exemplar_regions,
    gradient_energy,
    over_exemplar,
    repeat_of,
)
from ..metrics.views import (
    Comparison,
    consistency,
    contour_correlation,
    face_region,
    identity,
    known_means,
    pair_error,
    warp,
)
from .methods import SHOWN, Sitter, Views, landmarks_in, real_views

Figures = dict[str, float | None]

REGIONS = ("hair", "body")
"""Whose paint may repeat itself."""


def missing_networks() -> dict[str, list[str]]:
    """Missing networks, by the prefix of the figures' names that need them."""
    wanted = {**{f"lpips_{name}": list(networks) for name, networks in LPIPS_NETWORKS.items()},
              "fid_2048": ["inception-2048"], "fid": ["inception"], "kid": ["inception"],
              "identity": ["face-landmarker"]}
    found = {name: models.missing(networks) for name, networks in wanted.items()}
    return {name: networks for name, networks in found.items() if networks}


def distances(device: str = "auto") -> dict[str, Comparison]:
    """LPIPS of each backbone whose weights are at hand, computed on ``device``."""
    return {f"lpips_{name}": functools.partial(lpips, network=name, device=device)
            for name, networks in LPIPS_NETWORKS.items() if not models.missing(networks)}


class Target:
    """What a sitter's views in one style are measured against; computed once for all methods."""

    def __init__(self, sitter: Sitter, exemplar: Exemplar, crops: int, seed: int) -> None:
        self.sitter, self.exemplar, self.crops, self.seed = sitter, exemplar, crops, seed
        self.middle = len(sitter.close) // 2
        self.picture, masks = exemplar_regions(exemplar, sitter.unit, REGIONS, MARGIN * sitter.unit)
        scale = sitter.unit / exemplar.size
        self.face = face_region(self.picture.shape, exemplar.landmarks * scale)
        self.energy = gradient_energy(self.picture, self.face)
        self.patches = PatchIndex(self.picture)
        self.repeats = {name: repeat_of(self.picture, mask, sitter.unit)
                        for name, mask in masks.items()}

    @functools.cached_property
    def features(self) -> dict[str, Float64]:
        """Inception features of the exemplar's crops."""
        return inception_features(exemplar_crops(self.exemplar, self.crops, self.seed + 1),
                                  full=models.available("inception-2048"),
                                  device=self.sitter.device)

    @functools.cached_property
    def regions(self) -> list[dict[str, Bool]]:
        """Where the sitter's regions are in the close views."""
        labels = RowLabels.joined(*row_labels(self.sitter.skin))
        return labels.masks(self.sitter.field, self.sitter.close_cameras, REGIONS,
                            MARGIN * self.sitter.unit)


def measure(views: Views, target: Target, example: Views | None = None,
            say: Callable[[str], None] = lambda text: None) -> Figures:
    """All figures of a method's views by name, see `documents.COLUMNS`; None where unknown.

    Those of the real field give its floor. ``example``: the same views painted by transfer, each by
    itself: the other reference of Table 2.
    """
    say("consistency")
    figures = agreement(views, target.sitter)
    say("paint")
    figures |= _paint(views, target)
    say("likeness")
    figures |= _likeness(views, target)
    figures |= _pairs(views, target.sitter, example)
    if models.available("inception"):
        say("features")
        figures |= _style(views, target)
    return {name: None if value is None or np.isnan(value) else float(value)
            for name, value in figures.items()}


def _floats(pictures: list[UInt8]) -> list[Float32]:
    return [picture.astype(np.float32) / np.float32(255) for picture in pictures]


def agreement(views: Views, sitter: Sitter) -> Figures:
    """Consistency of neighbours, of views 7 apart and of the arc's ends; contrast.

    ``short_``, ``long_``, ``ends_`` with ``rmse``, ``normalised`` and ``lpips_...``; ``contrast``:
    gradient energy over the real field's. The sitter's field's depths say what is the same point.
    """
    arc, painted = sitter.arc, _floats(views.arc)
    rows = consistency(painted, arc.real, arc.cameras, gaps=(1, 7),
                       compare=distances(sitter.device))
    figures: Figures = {}
    for name, gap in (("short", "gap_1"), ("long", "gap_7"), ("ends", "extremes")):
        for key, value in rows.get(gap, {}).items():
            if key in ("rmse", "normalised") or key.startswith("lpips"):
                figures[f"{name}_{key}"] = value
    some = np.unique(np.linspace(0, len(painted) - 1, 4).round().astype(int))
    energies = np.array([[gradient_energy(picture, mask) for picture in (
        painted[view], np.clip(arc.real[view].color, 0, 1))]
        for view, mask in ((view, _inside(arc.masks[view])) for view in some)])
    figures["contrast"] = float(np.mean(energies[:, 0]) / np.mean(energies[:, 1]))
    return figures


def _inside(mask: Bool) -> Bool:
    """A mask without its outline, which is no paint."""
    return np.asarray(ndimage.binary_erosion(mask, np.ones((3, 3), bool), 3, border_value=1), bool)


def _paint(views: Views, target: Target) -> Figures:
    """Patches, sharpness and repeats in the close views."""
    sitter = target.sitter
    shown = [(views.close[view], sitter.close[view].alpha > 0.5, target.regions[view])
             for view in SHOWN]
    figures: Figures = {"patches": float(np.mean([
        target.patches.fidelity(picture, mask, seed=target.seed) for picture, mask, _ in shown]))}
    front = views.close[target.middle]
    face = face_region(front.shape, landmarks_in(sitter.close_cameras, target.middle,
                                                 sitter.landmarks))
    figures["sharpness"] = gradient_energy(front, face) / target.energy
    for name in REGIONS:
        own = target.repeats.get(name, Repeat(float("nan"), (0, 0), float("nan")))
        measured = Repeat(0.0, (0, 0), 1.0) if np.isnan(own.peak) else own
        ratios = [over_exemplar(repeat_of(picture, masks[name], sitter.unit), measured)
                  for picture, _, masks in shown if name in masks]
        known = [ratio for ratio in ratios if np.isfinite(ratio)]
        figures[f"repeats_{name}"] = max(known) if known else None
    return figures


def _likeness(views: Views, target: Target) -> Figures:
    """Whether the head is still the person."""
    sitter, middle = target.sitter, target.middle
    real = np.clip(sitter.close[middle].color, 0, 1)
    mask = sitter.close[middle].alpha > 0.5
    front = _floats([views.close[middle]])[0]
    figures: Figures = {"contours": contour_correlation(front, real, mask),
                        "content": feature_distance(front, real, mask,
                                                    device=sitter.device)}
    if models.available("face-landmarker"):
        found = identity(views.close, real_views(sitter).close, detect_landmarks)
        figures |= {"identity_error": found["nme"], "identity_found": found["detected"]}
    return figures


def _pairs(views: Views, sitter: Sitter, example: Views | None) -> Figures:
    """Table 2: PSNR, SSIM and LPIPS against the real field, and against the painted views."""
    arc = sitter.arc
    some = sorted({0, len(arc.real) // 2, len(arc.real) - 1})
    references = {"content": [np.clip(shot.color, 0, 1) for shot in arc.real]}
    if example is not None:
        references["example"] = _floats(example.arc)
    figures: Figures = {}
    for name, wanted in references.items():
        painted = _floats(views.arc)
        values = [psnr(a, b, mask) for a, b, mask in zip(painted, wanted, arc.masks, strict=True)]
        if not np.all(np.isfinite(values)):
            continue  # the reference itself
        figures[f"psnr_{name}"] = float(np.mean(values))
        figures[f"ssim_{name}"] = float(np.mean([ssim(a, b) for a, b in zip(painted, wanted)]))
        for key, distance in distances(sitter.device).items():
            figures[f"{key}_{name}"] = float(np.mean([
                distance(painted[view], np.asarray(wanted[view], np.float32), arc.masks[view])
                for view in some]))
    return figures


def _style(views: Views, target: Target) -> Figures:
    """Distances of Inception features of crops to the exemplar's."""
    sitter = target.sitter
    width = float(np.ptp(landmarks_in(sitter.close_cameras, target.middle, sitter.landmarks)[:, 0]))
    ours = inception_features(spread_crops(
        views.close, [shot.alpha > 0.5 for shot in sitter.close], max(int(CROP * width), 16),
        target.crops, target.seed), full=models.available("inception-2048"),
        device=sitter.device)
    figures: Figures = {f"fid_{name}": frechet_distance(ours[name], target.features[name])
                        for name in ours}
    figures["kid_768"] = kernel_distance(ours["768"], target.features["768"])
    return figures


PAIRS = 8
"""Pairs of photos for each gap, about."""
NEAR = (0.5, 1.6)
"""How wide a pair may be over the gap that is wanted."""


def photo_pairs(cameras: Camera, degrees: float) -> list[tuple[int, int]]:
    """Pairs of views whose directions to the head differ by about ``degrees``, nearest first.

    The cameras lie about the origin. At most `PAIRS`; no camera is in two, where there are enough.
    """
    direction = cameras.position / np.linalg.norm(cameras.position, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(direction @ direction.T, -1, 1)))
    first, second = np.triu_indices(len(cameras), 1)
    apart = angles[first, second]
    good = np.flatnonzero((apart > NEAR[0] * degrees) & (apart < NEAR[1] * degrees))
    chosen: list[tuple[int, int]] = []
    for pair in good[np.argsort(np.abs(apart[good] - degrees), kind="stable")]:
        one, other = int(first[pair]), int(second[pair])
        if len(chosen) < PAIRS and not any({one, other} & set(taken) for taken in chosen):
            chosen.append((one, other))
    return chosen


def photo_agreement(field: VoxelField, capture: Capture, gaps: dict[str, float],
                    size: int, device: str = "auto") -> dict[str, float | None]:
    """Consistency of a sitter's own photos by the same metric, as a reference.

    Photos are not on the arc. For each gap of the arc, those pairs of photos count whose directions
    differ by about as much; the depth is the field's, seen by the photos' cameras.

    Parameters
    ----------
    gaps : Angle in degrees by name (``short``, ``long``).
    size : Width in pixels that the photos are reduced to.

    Returns
    -------
    figures : By gap ``rmse``, ``normalised``, ``lpips_...`` and ``degrees``, the mean angle of its
        pairs; None where no two photos are as near.
    """
    cameras = capture.cameras.scaled(min(size / float(capture.cameras.width.max()), 1.0))
    shots: dict[int, Rendering] = {}
    figures: dict[str, float | None] = {}
    for name, degrees in gaps.items():
        pairs = photo_pairs(cameras, degrees)
        rows = []
        for first, second in pairs:
            for view in (first, second):
                if view not in shots:
                    shots[view] = field.render(cameras, view)
            rows.append(_pair(cameras, shots, first, second, _photo(capture, cameras, first),
                              _photo(capture, cameras, second), device))
        names = ["rmse", "normalised", *distances(device)]
        means = np.full(len(names), np.nan) if not rows else known_means(np.array(rows))
        figures |= {f"{name}_{key}": float(value) if np.isfinite(value) else None
                    for key, value in zip(names, means)}
        figures[f"{name}_degrees"] = float(np.mean([_angle(cameras, *pair) for pair in pairs])
                                           ) if pairs else None
    return figures


def _angle(cameras: Camera, first: int, second: int) -> float:
    a, b = cameras.position[first], cameras.position[second]
    return float(np.degrees(np.arccos(np.clip(
        a @ b / (np.linalg.norm(a) * np.linalg.norm(b)), -1, 1))))


def _photo(capture: Capture, cameras: Camera, view: int) -> Float32:
    """A photo on white at the cameras' size."""
    picture = to_uint8(capture.image_float(view))
    size = int(cameras.width[view]), int(cameras.height[view])
    small = Image.fromarray(picture).resize(size, Image.Resampling.BOX)
    return np.asarray(small, np.float32) / np.float32(255)


def _pair(cameras: Camera, shots: dict[int, Rendering], first: int, second: int,
          target: Float32, source: Float32, device: str) -> list[Any]:
    """Errors of one pair."""
    warped, valid = warp(source, cameras, second, first, shots[second].depth, shots[first].depth)
    return [*pair_error(target, warped, valid),
            *(distance(target, warped, valid) for distance in distances(device).values())]
