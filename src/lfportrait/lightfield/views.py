"""Rendering the pictures of level cameras by row slices: quilts, sweeps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numba
import numpy as np
from numpy.typing import NDArray

from ..capture import Camera
from ..device import gpu_adapter
from ..field import Rendering, VoxelField, camera_row
from .ground import Ground
from .kernels.views import view_kernel

__all__ = ["eight_bit", "render_views"]

_FAINTEST = 2e-4
"""Slices leave out samples that hold back less light than this."""
_STOP = 4e-3
"""Transmittance at which a ray ends; the rest, a level of 8 bits, is taken to have its color."""
_TOGETHER = 64 << 20
"""Bytes of pictures that are rendered at once."""
_STEEPEST = 50.0
"""Degrees between a ray and the normal of the planes, at most: there is one sample a plane."""
_LEVEL = 1e-9
"""What a camera's axes may lie off the horizon, as a sine."""


def eight_bit(color: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Colors in [0, 1] as bytes; the colors are overwritten."""
    color *= np.float32(255.0)
    color += np.float32(0.5)
    return np.clip(color, 0.5, 255.5, out=color).astype(np.uint8)


def _rays(row: NDArray[np.float64], size: tuple[int, int], corners: NDArray[np.float64],
          ) -> tuple[float, float] | None:
    """Slopes x / z of the first and last ray that a camera sends at the lattice, in its own frame.

    Parameters
    ----------
    row
        float64 [16], the camera (`camera_row`).
    size
        Width and height of its picture.
    corners
        float64 [4, 2], x and z of the lattice's corners.

    Returns
    -------
    slopes
        None if the lattice reaches behind the camera, or up to it.
    """
    from_eye = corners - row[[3, 11]]
    ahead = from_eye @ row[[2, 10]]
    if ahead.min() <= 1e-3 * np.abs(corners).max():
        return None
    slopes = (from_eye @ row[[0, 8]]) / ahead
    edges = (np.array([0.5, size[0] - 0.5]) - row[14]) / row[12]
    low, high = max(slopes.min(), edges[0]), min(slopes.max(), edges[1])
    return (float(low), float(high)) if low <= high else (float(edges[0]), float(edges[0]))


def _fits(field: VoxelField, row: NDArray[np.float64], slopes: tuple[float, float] | None) -> bool:
    """Whether a camera's rays go through slices: it is level, and looks along the planes' normal.

    The kernel reads 63 columns at a time, of at most 1024, and a ray may not leave them within 16
    planes.
    """
    lattice, bounds = field.lattice, math.tan(math.radians(_STEEPEST))
    level = max(abs(row[4]), abs(row[6]), abs(row[1]), abs(row[9])) <= _LEVEL
    if slopes is None or not level or lattice[0] > 1024 or 16 * bounds * lattice[3] / lattice[5
                                                                                  ] >= 60:
        return False
    for slope in slopes:
        x, z = row[[0, 8]] * slope + row[[2, 10]]
        if z >= 0 or abs(x) > bounds * -z:
            return False
    return True


def _beside(row: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether two level cameras' rows lie in the same planes."""
    same = [0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 13, 15]
    ahead = row[[2, 10]] @ (row[[3, 11]] - other[[3, 11]])
    return bool(np.abs(row[same] - other[same]).max() <= _LEVEL and abs(ahead) <= _LEVEL)


def render_views(field: VoxelField, cameras: Camera, views: Sequence[int] | None = None, *,
                 background: float | NDArray[np.floating] = 1.0,
                 ground: Ground | None = None, device: str = "cpu") -> Iterator[Rendering]:
    """What `VoxelField.render` gives of several views, in their order, in less time.

    Level cameras that look at the lattice from its front are rendered by slices of the field, one
    for each row of those that stand side by side. All others are rendered one by one.

    Parameters
    ----------
    field
        The field.
    cameras, views
        Batch of cameras, and which of them; all by default.
    background
        Grey level or RGB behind the field.
    ground
        What is behind it instead.
    device
        Where to compute (`lfportrait.device.gpu_adapter`).

    Yields
    ------
    rendering
        Of the next view. What it holds may be overwritten once the one after is asked for.
    """
    wanted = list(range(len(cameras)) if views is None else views)
    x, z = field.bounds[:, 0], field.bounds[:, 2]
    corners = np.array([(i, k) for i in x for k in z])
    while wanted:
        first = wanted[0]
        size = int(cameras.width[first]), int(cameras.height[first])
        row = camera_row(cameras, first)
        slopes = _rays(row, size, corners)
        if gpu_adapter(device) is not None or not _fits(field, row, slopes):
            behind = background if ground is None else ground.seen(cameras, first)
            yield field.render(cameras, first, background=behind, device=device)
            wanted.pop(0)
            continue
        rows, reach = [], 0.0
        most = max(1, _TOGETHER // (20 * size[0] * size[1]))
        for view in wanted[:most]:
            other = camera_row(cameras, view)
            slopes = _rays(other, size, corners)
            if ((int(cameras.width[view]), int(cameras.height[view])) != size
                    or not _beside(row, other) or not _fits(field, other, slopes)):
                break
            assert slopes is not None
            rows.append(other)
            reach = max(reach, abs(slopes[0]), abs(slopes[1]))
        yield from _together(field, cameras, wanted[:len(rows)], np.array(rows), size, reach,
                             background, ground)
        del wanted[:len(rows)]


def _together(field: VoxelField, cameras: Camera, views: Sequence[int],
              rows: NDArray[np.float64], size: tuple[int, int], reach: float,
              background: float | NDArray[np.floating],
              ground: Ground | None) -> Iterator[Rendering]:
    """Views whose rows lie in the same planes; ``reach`` is the largest slope of their rays."""
    stretches, lattice = field.stretches, field.lattice
    shape = len(views), size[1], size[0]
    color = np.empty((*shape, 3), np.float32)
    alpha, depth = np.empty(shape, np.float32), np.empty(shape, np.float32)
    view_kernel(field.basis)(
        stretches.places, stretches.occupied, stretches.values, lattice, rows,
        np.float32(1.0 / math.hypot(1.0, reach)), 1, np.float32(_FAINTEST * lattice[5]),
        np.float32(_STOP), numba.get_num_threads(), color, alpha, depth)
    for place, view in enumerate(views):
        behind = background if ground is None else ground.seen(cameras, view)
        yield field.finished(cameras, view, Rendering(color[place], alpha[place], depth[place]),
                             background=behind)
