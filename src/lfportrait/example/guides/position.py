"""Position guide: the exemplar's coordinate of every pixel, by moving least squares.

Similarities lead from the target's control points to the exemplar's (Schaefer et al. 2006). What
falls outside the exemplar is folded back inside. Positions are continuous pixel coordinates: the
middle of the first pixel is (0.5, 0.5).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..kernels.guides import fold_points, mls_points, resample_fold, resample_grid

__all__ = ["fold_inside", "folded_position_guide", "mls_similarity", "pixel_centres",
           "position_guide"]

Float32 = NDArray[np.float32]


def mls_similarity(points: NDArray[np.floating], sources: NDArray[np.floating],
                   targets: NDArray[np.floating],
                   weights: NDArray[np.floating] | None = None,
                   softness: NDArray[np.floating] | None = None) -> NDArray[np.float64]:
    """Moving least squares with similarities (Schaefer et al. 2006, alpha = 1).

    Parameters
    ----------
    points
        [N, 2] points to map.
    sources, targets
        [M, 2] control points and their images.
    weights
        [M] importance of each control point away from it, default 1.
    softness
        [M] distance within which a control point attracts instead of pinning, default 0: then
        ``f(sources[i]) = targets[i]`` exactly. Isolated points would pull out spikes.

    Returns
    -------
    float64 [N, 2], the mapped points.
    """
    sources, targets = (np.ascontiguousarray(a, np.float64) for a in (sources, targets))
    points = np.ascontiguousarray(points, np.float64)
    importance = np.ones(len(sources)) if weights is None else np.asarray(weights, np.float64)
    out = np.empty_like(points)
    soft = np.zeros(len(sources)) if softness is None else np.asarray(softness, np.float64) ** 2
    mls_points(points, sources, targets, importance, soft, out)
    return out


def position_guide(shape: tuple[int, ...], target_landmarks: NDArray[np.floating],
                   exemplar_landmarks: NDArray[np.floating], *,
                   weights: NDArray[np.floating] | None = None,
                   softness: NDArray[np.floating] | None = None, grid: int = 4) -> Float32:
    """The exemplar's coordinate of every pixel of a target picture.

    Parameters
    ----------
    shape
        (H, W, ...) of the target.
    target_landmarks, exemplar_landmarks
        [M, 2] matching control points in pixels; rows with NaN on either side are left out.
    weights
        [M] importance of the control points.
    softness
        [M] in pixels, see `mls_similarity`.
    grid
        The map is evaluated every ``grid`` pixels and bilinear between; 1 evaluates every pixel.

    Returns
    -------
    float32 [H, W, 2], (x, y) in exemplar pixels; may lie outside the exemplar.
    """
    known = np.isfinite(target_landmarks).all(axis=1) & np.isfinite(exemplar_landmarks).all(axis=1)
    importance = np.ones(len(known)) if weights is None else np.asarray(weights)
    soft = np.zeros(len(known)) if softness is None else np.asarray(softness)
    nodes = _nodes(shape, target_landmarks[known], exemplar_landmarks[known], importance[known],
                   soft[known], grid)
    out = np.empty((*shape[:2], 2), np.float32)
    resample_grid(nodes, grid, out)
    return out


def folded_position_guide(cover: Float32, target: NDArray[np.floating],
                          exemplar: NDArray[np.floating], weights: NDArray[np.floating],
                          softness: NDArray[np.floating], shape: tuple[int, ...],
                          inner: tuple[float, float, float, float], grid: int = 4,
                          move: Callable[[Float32], None] | None = None) -> Float32:
    """`position_guide` and `fold_inside` in one pass, NaN where ``cover`` [H, W] is 0.

    ``move`` may change the places [h, w, 2] of every ``grid``-th pixel before the fold.
    """
    known = np.isfinite(target).all(axis=1) & np.isfinite(exemplar).all(axis=1)
    nodes = _nodes(cover.shape, target[known], exemplar[known], weights[known], softness[known],
                   grid)
    if move is not None:
        move(nodes)
    out = np.empty((*cover.shape, 2), np.float32)
    resample_fold(nodes, grid, cover, *_strips(shape, inner), out)
    return out


def _nodes(shape: tuple[int, ...], sources: NDArray[np.floating], targets: NDArray[np.floating],
           weights: NDArray[np.floating], softness: NDArray[np.floating], grid: int) -> Float32:
    """The map at every ``grid``-th pixel of a picture, float32 [h, w, 2]."""
    height, width = shape[:2]
    columns, rows = -(-(width - 1) // grid) + 1, -(-(height - 1) // grid) + 1
    x, y = np.meshgrid(np.arange(max(columns, 2)) * grid + 0.5,
                       np.arange(max(rows, 2)) * grid + 0.5)
    nodes = mls_similarity(np.stack([x.ravel(), y.ravel()], axis=1), sources, targets, weights,
                           softness)
    return nodes.reshape(*x.shape, 2).astype(np.float32)


def _strips(shape: tuple[int, ...], inner: tuple[float, float, float, float],
            ) -> tuple[Float32, Float32, Float32]:
    """Size of the exemplar (x, y), and the strips before and after the head's box."""
    size = np.array([shape[1], shape[0]], np.float32)
    before = np.clip(np.array(inner[:2]), 6.0, size / 2)
    after = np.clip(size - np.array(inner[2:]), 6.0, size / 2)
    return size, before.astype(np.float32), after.astype(np.float32)


def fold_inside(position: Float32, shape: tuple[int, ...],
                inner: tuple[float, float, float, float], out: Float32 | None = None) -> Float32:
    """Bring positions outside the exemplar back inside by reflection, never into the head.

    A position beyond a border is reflected to and fro between the border and the head's box, so
    that the outside continues the exemplar's background (or clothes) instead of smearing its last
    row.

    Parameters
    ----------
    position
        float32 [..., 2], exemplar coordinates.
    shape
        (H, W, ...) of the exemplar.
    inner
        (left, top, right, bottom): the head's box in the exemplar.
    out
        What to change; None makes a copy. ``position`` itself will do.
    """
    if out is None:
        out = np.empty(position.shape, np.float32)
    if out is not position:
        out[:] = position
    fold_points(out.reshape(-1, 2), *_strips(shape, inner))
    return out


def pixel_centres(shape: tuple[int, ...]) -> Float32:
    """Continuous coordinates (x, y) of the pixel centres of a picture (H, W, ...), [H, W, 2]."""
    x, y = np.meshgrid(np.arange(shape[1], dtype=np.float32) + np.float32(0.5),
                       np.arange(shape[0], dtype=np.float32) + np.float32(0.5))
    return np.stack([x, y], axis=-1)
