"""Guides of the synthesis in float32: where in the exemplar a pixel belongs, and how it looks.

Position guide: the exemplar's coordinate of every pixel, by moving least squares (similarity) from
the target's control points to the exemplar's. Appearance guide (Fig. 4): grey minus its Gaussian
blur, the target's distribution matched to the exemplar's inside the head. Positions are continuous
pixel coordinates: the middle of the first pixel is (0.5, 0.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..kernels.example_guides import blur_rows, mls_points, resample_grid

__all__ = [
    "Guides", "anchor_scale", "appearance_guide", "fold_inside", "gaussian_blur", "grey",
    "match_histogram", "mls_similarity", "pixel_centres", "position_guide", "relative_stretch",
    "sample_labels",
]

Float32 = NDArray[np.float32]


@dataclass
class Guides:
    """Guides of one target picture.

    Attributes
    ----------
    position
        float32 [H, W, 2], exemplar pixel coordinates (x, y); NaN where nothing is to be painted.
    appearance
        float32 [H, W], grey minus blur in [-1, 1], matched to the exemplar's distribution.
    labels
        uint8 [H, W, K], soft region labels (255 = wholly inside), see `regions.LABELS`.
    anchor
        float32 [H, W, 2], the pixel's place in the plane of the seed grid, in exemplar pixels.
    """

    position: Float32
    appearance: Float32
    labels: NDArray[np.uint8]
    anchor: Float32


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
    height, width = shape[:2]
    columns, rows = -(-(width - 1) // grid) + 1, -(-(height - 1) // grid) + 1
    x, y = np.meshgrid(np.arange(max(columns, 2)) * grid + 0.5,
                       np.arange(max(rows, 2)) * grid + 0.5)
    nodes = mls_similarity(np.stack([x.ravel(), y.ravel()], axis=1), target_landmarks[known],
                           exemplar_landmarks[known], importance[known], soft[known])
    out = np.empty((height, width, 2), np.float32)
    resample_grid(nodes.reshape(*x.shape, 2).astype(np.float32), grid, out)
    return out


def fold_inside(position: Float32, shape: tuple[int, ...],
                inner: tuple[float, float, float, float]) -> Float32:
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
    """
    out = np.array(position, np.float32)
    for axis, length in enumerate((shape[1], shape[0])):
        value = out[..., axis]
        before = np.float32(np.clip(inner[axis], 6.0, length / 2))
        after = np.float32(np.clip(length - inner[axis + 2], 6.0, length / 2))
        last = np.float32(length - 0.01)
        with np.errstate(invalid="ignore"):
            beyond = np.mod(-value, 2 * before)
            value = np.where(value < 0, np.minimum(beyond, 2 * before - beyond), value)
            beyond = np.mod(value - last, 2 * after)
            value = np.where(value > last, last - np.minimum(beyond, 2 * after - beyond), value)
        out[..., axis] = value
    return out


def grey(image: NDArray[np.generic]) -> Float32:
    """Luma (Rec. 601) in [0, 1] of a picture, uint8 or float in [0, 1], [H, W, 3]."""
    scale = 1 / 255 if image.dtype == np.uint8 else 1.0
    weights = np.array([0.299, 0.587, 0.114], np.float32) * np.float32(scale)
    return np.asarray(np.asarray(image[..., :3], np.float32) @ weights, np.float32)


def gaussian_blur(image: Float32, sigma: float) -> Float32:
    """Gaussian blur of [H, W] with mirrored borders; kernel cut at 3 sigma."""
    radius = max(1, int(np.ceil(3 * sigma)))
    taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    taps = (taps / taps.sum()).astype(np.float32)
    rows = np.empty_like(image)
    blur_rows(np.ascontiguousarray(image), taps, rows)
    turned = np.ascontiguousarray(rows.T)
    columns = np.empty_like(turned)
    blur_rows(turned, taps, columns)
    return np.ascontiguousarray(columns.T)


def appearance_guide(image: NDArray[np.generic], sigma: float, grain: float = 0.0) -> Float32:
    """Grey minus its Gaussian blur (Fig. 4), float32 [H, W] in [-1, 1].

    Parameters
    ----------
    image
        uint8 or float in [0, 1], [H, W, 3].
    sigma
        Of the blur, in pixels: slower changes of light are taken out.
    grain
        Sigma in pixels of a blur of the guide itself; 0 keeps the finest detail.
    """
    luma = grey(image)
    guide = luma - gaussian_blur(luma, sigma)
    return gaussian_blur(guide, grain) if grain > 0.3 else guide


def match_histogram(values: Float32, reference: NDArray[np.float32], inside: NDArray[np.bool_],
                    bins: int = 1024) -> Float32:
    """Map ``values`` so that those ``inside`` are distributed as ``reference`` (Fig. 4 g).

    Parameters
    ----------
    values
        float32 [H, W].
    reference
        float32, any shape: the wanted distribution.
    inside
        bool [H, W]: the values that count; all values are mapped.
    bins
        Resolution of the cumulative distributions; the map is linear between bins.
    """
    sample = values[inside] if inside.any() else values.ravel()
    reach = float(max(np.abs(sample).max(), np.abs(reference).max(), 1e-6))
    edges = np.linspace(-reach, reach, bins + 1)
    own = np.concatenate([[0], np.cumsum(np.histogram(sample, edges)[0])]) / sample.size
    wanted = np.concatenate([[0], np.cumsum(np.histogram(reference, edges)[0])]) / reference.size
    # A little slope everywhere makes both distributions invertible where they have gaps.
    ramp = np.linspace(0, 1e-6, bins + 1)
    mapping = np.interp(own + ramp, wanted + ramp, edges)
    index = np.clip((values + np.float32(reach)) * np.float32(bins / (2 * reach)), 0, bins)
    low = np.minimum(index.astype(np.int32), bins - 1)
    table = mapping.astype(np.float32)
    return table[low] + (index - low) * (table[low + 1] - table[low])


def pixel_centres(shape: tuple[int, ...]) -> Float32:
    """Continuous coordinates (x, y) of the pixel centres of a picture (H, W, ...), [H, W, 2]."""
    x, y = np.meshgrid(np.arange(shape[1], dtype=np.float32) + np.float32(0.5),
                       np.arange(shape[0], dtype=np.float32) + np.float32(0.5))
    return np.stack([x, y], axis=-1)


def sample_labels(labels: NDArray[np.uint8], position: Float32) -> NDArray[np.uint8]:
    """Labels [h, w, K] of the exemplar at the positions [H, W, 2]; 0 where those are NaN."""
    known = np.isfinite(position[..., 0])
    safe = np.where(known[..., None], position, 0)
    x = np.clip(safe[..., 0].astype(np.int64), 0, labels.shape[1] - 1)
    y = np.clip(safe[..., 1].astype(np.int64), 0, labels.shape[0] - 1)
    return np.ascontiguousarray(np.where(known[..., None], labels[y, x], 0), np.uint8)


def _steps(field: Float32) -> tuple[Float32, Float32]:
    """Length of the change of ``field`` [H, W, 2] to the next pixel along x and along y, [H, W]."""
    along_x, along_y = (np.full(field.shape[:2], np.nan, np.float32) for _ in range(2))
    along_x[:, :-1] = np.hypot(*np.moveaxis(field[:, 1:] - field[:, :-1], -1, 0))
    along_y[:-1] = np.hypot(*np.moveaxis(field[1:] - field[:-1], -1, 0))
    return along_x, along_y


def anchor_scale(anchor: Float32) -> float:
    """Exemplar pixels per target pixel of an anchor plane: median of its smaller steps."""
    along_x, along_y = _steps(anchor)
    smaller = np.fmin(along_x, along_y)
    smaller = smaller[np.isfinite(smaller)]
    return float(np.median(smaller)) if smaller.size else 1.0


def relative_stretch(position: Float32, anchor: Float32, least: float = 0.1) -> Float32:
    """How much slower the position changes than the anchor, float32 [H, W] in [least, 1].

    Where many surface points share a place in the exemplar (the back of a head), the position can't
    ask for more than that: its weight falls in proportion.
    """
    ratio = np.ones(position.shape[:2], np.float32)
    for moved, steady in zip(_steps(position), _steps(anchor)):
        with np.errstate(divide="ignore", invalid="ignore"):
            share = moved / steady
        ratio = np.fmin(ratio, np.where(np.isfinite(share), share, np.float32(1)))
    return gaussian_blur(np.clip(ratio, np.float32(least), np.float32(1)), 2.0)
