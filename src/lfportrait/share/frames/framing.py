"""The head in a picture's frame, as large as it may be in all views that are shown."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...field import VoxelField
from ...lightfield import Display, EncodeConfig

__all__ = ["Margins", "framed"]

_SOLID = 10.0
"""Densities below this are fog, which nobody sees at the border."""
_OUTERMOST = 5e-4
"""Share of the solid points that may stand out at each side: what floats about the head."""
_MOST_POINTS = 20_000
_NEAREST = 0.9
"""How near the head may come to the eyes, as a share of their distance."""


@dataclasses.dataclass(frozen=True)
class Margins:
    """What is left free around a head, as shares of the picture's height (top, bottom) and width.

    ``stands``: the head stands on the lower margin; otherwise it is in the middle.
    """

    top: float = 0.04
    bottom: float = 0.04
    side: float = 0.04
    stands: bool = False


def framed(field: VoxelField, window: Display, encode: EncodeConfig, margins: Margins, *,
           turns: Sequence[float] = (0.0,), eyes: Sequence[float] = (0.0,)) -> EncodeConfig:
    """The placement whose head fills the frame within its margins.

    Parameters
    ----------
    field
        Whose head.
    window
        The frame, with the eyes' distance.
    encode
        Size and shifts away from their defaults change the framing in proportion; the rest is kept.
    margins
        What is left free.
    turns
        Degrees by which the head is turned besides ``encode.turn``.
    eyes
        X of the eyes in half heights of the frame.
    """
    points, voxel = _outline(field)
    views = []
    for turn in turns:
        angle = np.radians(encode.turn + turn)
        x, z = points[:, 0], points[:, 2]
        # As `Placement.to_world` turns it, backwards.
        views.append(np.stack([np.cos(angle) * x + np.sin(angle) * z, points[:, 1],
                               np.cos(angle) * z - np.sin(angle) * x], axis=1))
    seen = np.concatenate(views)
    low, high = 0.0, 4.0
    for _ in range(40):
        scale = (low + high) / 2
        shifts = _room(seen, scale, voxel, window, encode, margins, eyes)
        low, high = (scale, high) if shifts else (low, scale)
    shifts = _room(seen, low, voxel, window, encode, margins, eyes)
    if shifts is None or low < 0.005:
        raise UserError("the head does not fit between the eyes and the picture: lower "
                        "--encode.focus")
    usual = EncodeConfig()
    shift = shifts[0] if margins.stands else (shifts[0] + shifts[1]) / 2
    return dataclasses.replace(
        # `Placement.of` makes heads smaller on narrow panels; here the frame does.
        encode, size=low / min(1.0, window.aspect * 1.15) * encode.size / usual.size,
        shift_x=encode.shift_x - usual.shift_x, shift_y=shift + encode.shift_y - usual.shift_y)


def _outline(field: VoxelField) -> tuple[NDArray[np.float64], float]:
    """Solid points of a field, float64 [N, 3], and the size of its voxels."""
    solid = field.density > _SOLID
    points: NDArray[Any] = field.lattice_points()[solid] if solid.any() else field.bounds
    low, high = np.quantile(points, [_OUTERMOST, 1 - _OUTERMOST], axis=0)
    points = points[((points >= low) & (points <= high)).all(axis=1)] if len(points) > 2 else points
    voxel = float((2.0 * field.radius / field.links.shape[::-1]).max())
    return np.asarray(points[::len(points) // _MOST_POINTS + 1], np.float64), voxel


def _room(points: NDArray[np.float64], scale: float, voxel: float, window: Display,
          encode: EncodeConfig, margins: Margins, eyes: Sequence[float],
          ) -> tuple[float, float] | None:
    """Lowest and highest shift upwards with which a head of this scale lies within the margins."""
    distance = window.distance
    depth = encode.depth_scale * scale * points[:, 2] + encode.focus
    if depth.max() > _NEAREST * distance:
        return None
    larger = distance / (distance - depth)
    pad = 2 * scale * voxel
    across = window.aspect * (1 - 2 * margins.side)
    for eye in eyes:
        place = eye + (scale * points[:, 0] - eye) * larger
        if np.abs(place).max() + pad > across:
            return None
    low = float(((-1 + 2 * margins.bottom) / larger - scale * points[:, 1]).max()) + pad
    high = float(((1 - 2 * margins.top) / larger - scale * points[:, 1]).min()) - pad
    return (low, high) if low <= high else None
