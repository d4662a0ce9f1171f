"""Consistency of a sitter's own photos by the same metric, as a reference.

Photos are not on the arc. For each gap of the arc, those pairs of photos count whose directions
differ by about as much; the depth is the field's, seen by the photos' cameras.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lfportrait.capture import Camera, Capture
from lfportrait.field import Rendering, VoxelField

from ..metrics.consistency import pair_error, warp
from .figures import distances

__all__ = ["photo_agreement", "photo_pairs"]

PAIRS = 8
"""Pairs of photos for each gap, about."""
NEAR = (0.5, 1.6)
"""How wide a pair may be over the gap that is wanted."""


def photo_pairs(cameras: Camera, degrees: float, count: int = PAIRS) -> list[tuple[int, int]]:
    """Pairs of views whose directions to the head differ by about ``degrees``, nearest first.

    Parameters
    ----------
    cameras
        V cameras about the origin.
    degrees
        Wanted angle between the two.
    count
        At most so many; no camera is in two pairs, where there are enough.
    """
    direction = cameras.position / np.linalg.norm(cameras.position, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(direction @ direction.T, -1, 1)))
    first, second = np.triu_indices(len(cameras), 1)
    apart = angles[first, second]
    good = np.flatnonzero((apart > NEAR[0] * degrees) & (apart < NEAR[1] * degrees))
    chosen: list[tuple[int, int]] = []
    for pair in good[np.argsort(np.abs(apart[good] - degrees), kind="stable")]:
        one, other = int(first[pair]), int(second[pair])
        if len(chosen) < count and not any({one, other} & set(taken) for taken in chosen):
            chosen.append((one, other))
    return chosen


def photo_agreement(field: VoxelField, capture: Capture, gaps: dict[str, float],
                    size: int, device: str = "auto") -> dict[str, float | None]:
    """Consistency of the photos.

    Parameters
    ----------
    field, capture
        Of the sitter.
    gaps
        Angle in degrees by name (``short``, ``long``).
    size
        Width in pixels that the photos are reduced to.
    device
        Where networks compute, a choice of ``--device``.

    Returns
    -------
    figures
        By gap ``rmse``, ``normalised``, ``lpips_...`` and ``degrees``, the mean angle of its
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
        means = np.full(len(names), np.nan) if not rows else _known_means(np.array(rows))
        figures |= {f"{name}_{key}": float(value) if np.isfinite(value) else None
                    for key, value in zip(names, means)}
        figures[f"{name}_degrees"] = float(np.mean([_angle(cameras, *pair) for pair in pairs])
                                           ) if pairs else None
    return figures


def _known_means(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    known = np.isfinite(rows)
    return np.where(known.any(axis=0), np.where(known, rows, 0).sum(axis=0)
                    / np.maximum(known.sum(axis=0), 1), np.nan)


def _angle(cameras: Camera, first: int, second: int) -> float:
    a, b = cameras.position[first], cameras.position[second]
    return float(np.degrees(np.arccos(np.clip(
        a @ b / (np.linalg.norm(a) * np.linalg.norm(b)), -1, 1))))


def _photo(capture: Capture, cameras: Camera, view: int) -> NDArray[np.float32]:
    """A photo on white at the cameras' size."""
    picture = (capture.image_float(view) * 255 + 0.5).astype(np.uint8)
    size = int(cameras.width[view]), int(cameras.height[view])
    small = Image.fromarray(picture).resize(size, Image.Resampling.BOX)
    return np.asarray(small, np.float32) / np.float32(255)


def _pair(cameras: Camera, shots: dict[int, Rendering], first: int, second: int,
          target: NDArray[np.float32], source: NDArray[np.float32], device: str) -> list[Any]:
    """Errors of one pair."""
    warped, valid = warp(source, cameras, second, first, shots[second].depth, shots[first].depth)
    return [*pair_error(target, warped, valid),
            *(distance(target, warped, valid) for distance in distances(device).values())]
