"""Position guide: the exemplar's coordinate of every pixel, by moving least squares.

Similarities lead from the target's control points to the exemplar's (Schaefer et al. 2006). What
falls outside the exemplar is folded back inside. Positions are continuous pixel coordinates: the
middle of the first pixel is (0.5, 0.5). `Guides` holds all guides of a target, and the mapping of
its pixels to the plane of its seeds.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...arrays import Float32, Float64, Floats, UInt8
from ..kernels.guides import fold_points, mls_points, resample_fold, resample_grid, stretch
from .filters import enlarged, gaussian_blur


def mls_similarity(points: Floats, sources: Floats, targets: Floats, weights: Floats | None = None,
                   softness: Floats | None = None) -> Float64:
    """Points [N, 2] mapped by moving least squares with similarities, float64 [N, 2].

    Schaefer et al. 2006, alpha = 1.

    Parameters
    ----------
    sources, targets : [M, 2] control points and their images.
    weights : [M] importance of each control point away from it, default 1.
    softness : [M] distance within which a control point attracts instead of pinning, default 0:
        then ``f(sources[i]) = targets[i]`` exactly. Isolated points would pull out spikes.
    """
    sources, targets = (np.ascontiguousarray(a, np.float64) for a in (sources, targets))
    points = np.ascontiguousarray(points, np.float64)
    importance = np.ones(len(sources)) if weights is None else np.asarray(weights, np.float64)
    out = np.empty(points.shape)
    soft = np.zeros(len(sources)) if softness is None else np.asarray(softness, np.float64) ** 2
    mls_points(points, sources, targets, importance, soft, out)
    return out


def position_guide(shape: tuple[int, ...], target_landmarks: Floats,
                   exemplar_landmarks: Floats, *, grid: int = 4) -> Float32:
    """The exemplar's coordinate (x, y) of every pixel of a target picture, float32 [H, W, 2].

    It may lie outside the exemplar.

    Parameters
    ----------
    target_landmarks, exemplar_landmarks : [M, 2] matching control points in pixels; rows with NaN
        on either side are left out.
    grid : The map is evaluated every ``grid`` pixels and bilinear between.
    """
    known = np.isfinite(target_landmarks).all(axis=1) & np.isfinite(exemplar_landmarks).all(axis=1)
    count = int(known.sum())
    nodes = _nodes(shape, target_landmarks[known], exemplar_landmarks[known], np.ones(count),
                   np.zeros(count), grid)
    out = np.empty((*shape[:2], 2), np.float32)
    resample_grid(nodes, grid, out)
    return out


ControlPoints = tuple[Float64, Float64, Float64, Float64]
"""Points of a picture and of the exemplar, [M, 2] each, and their weights and softness, [M] each
(`mls_similarity`)."""


def folded_position_guide(cover: Float32, points: ControlPoints, shape: tuple[int, ...],
                          inner: tuple[float, float, float, float], grid: int = 4,
                          move: Callable[[Float32], None] | None = None) -> Float32:
    """`position_guide` and `fold_inside` in one pass, NaN where ``cover`` [H, W] is 0.

    ``points`` may be unknown (NaN) in part; ``shape`` (H, W, ...) is the exemplar's, ``inner`` the
    head's box there. ``move`` may change the places [h, w, 2] of every ``grid``-th pixel before the
    fold.
    """
    known = np.isfinite(points[0]).all(axis=1) & np.isfinite(points[1]).all(axis=1)
    target, exemplar, weights, softness = (part[known] for part in points)
    nodes = _nodes(cover.shape, target, exemplar, weights, softness, grid)
    if move is not None:
        move(nodes)
    out = np.empty((*cover.shape, 2), np.float32)
    resample_fold(nodes, grid, cover, *_strips(shape, inner), out)
    return out


def _nodes(shape: tuple[int, ...], sources: Floats, targets: Floats,
           weights: Floats, softness: Floats, grid: int) -> Float32:
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
    position, shape : float32 [..., 2], exemplar coordinates, and its (H, W, ...).
    inner : (left, top, right, bottom): the head's box in the exemplar.
    out : What to change, perhaps ``position`` itself; None makes a copy.
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


@dataclass
class Guides:
    """Guides of one target picture."""

    # float32 [H, W, 2], exemplar pixel coordinates (x, y); NaN where nothing is to be painted.
    position: Float32
    # float32 [H, W], grey minus blur in [-1, 1], matched to the exemplar's distribution.
    appearance: Float32
    labels: UInt8  # uint8 [H, W, K], soft region labels (255 = wholly inside), by `PICTURE_LABELS`.
    # float32 [H, W, 2], the pixel's place in the plane of the seed grid, in exemplar pixels.
    anchor: Float32


def sample_labels(labels: UInt8, position: Float32) -> UInt8:
    """Labels [h, w, K] of the exemplar at the positions [H, W, 2]; 0 where those are NaN."""
    known = np.isfinite(position[..., 0])
    safe = np.where(known[..., None], position, 0)
    x = np.clip(safe[..., 0].astype(np.int64), 0, labels.shape[1] - 1)
    y = np.clip(safe[..., 1].astype(np.int64), 0, labels.shape[0] - 1)
    return np.ascontiguousarray(np.where(known[..., None], labels[y, x], 0), np.uint8)


def anchor_scale(anchor: Float32) -> float:
    """Exemplar pixels per target pixel of an anchor plane: median of its smaller steps.

    In every eighth pixel of every eighth row.
    """
    here = anchor[:-1:8, :-1:8]
    along_x, along_y = (np.hypot(*np.moveaxis(next_one[:here.shape[0], :here.shape[1]] - here,
                                              -1, 0))
                        for next_one in (anchor[:-1:8, 1::8], anchor[1::8, :-1:8]))
    smaller = np.fmin(along_x, along_y)
    smaller = smaller[np.isfinite(smaller)]
    return float(np.median(smaller)) if smaller.size else 1.0


def relative_stretch(position: Float32, anchor: Float32, cell: int = 1) -> Float32:
    """How much slower the position changes than the anchor, float32 [H, W] in [0.1, 1].

    Where many surface points share a place in the exemplar (the back of a head), the position can't
    ask for more than that: its weight falls in proportion. Only one pixel of each ``cell`` x
    ``cell`` is looked at.
    """
    height, width = position.shape[:2]
    ratio = np.empty((-(-height // cell), -(-width // cell)), np.float32)
    stretch(position, anchor, np.float32(0.1), cell, ratio)
    return enlarged(gaussian_blur(ratio, 2.0 / cell), cell, (height, width))
