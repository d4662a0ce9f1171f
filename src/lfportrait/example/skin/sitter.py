"""The skin of a sitter: the head's visible surface with all that painting it needs.

A `Skin` is computed once from a field and its landmarks, and kept beside the field; it knows
nothing of any exemplar. Besides the atlas (`charts`) it holds what the sitter shows where: hair (by
the segmentation network, asked about the charts that stand upright), clothes (what lies below the
chin and differs in colour from the face), and how well the photos saw a place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...capture import Camera
from ...field import VoxelField
from ..guides.blurs import gaussian_blur
from .charts import Atlas, draw_atlas

__all__ = ["PIXELS", "Skin", "skin_distance"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

PIXELS = 384.0
"""Pixels of the charts per world unit: a head is about 600 high, as in most exemplars."""
UPRIGHT = 30.0
"""Charts of this pitch (degrees) at most are shown to the networks."""


@dataclass(frozen=True)
class Skin:
    """The visible surface of one head.

    Attributes
    ----------
    atlas
        Charts side by side, [H, W].
    landmarks
        float64 [68, 3] in the portrait frame; NaN rows are unknown.
    pixels
        Pixels of the charts per world unit.
    hair
        float32 [H, W] in [0, 1], or None where it could not be told.
    clothes
        float32 [H, W] in [0, 1]: what lies below the chin and is not of the face's colour.
    ears
        float32 [H, W] in [0, 1].
    seen
        float32 [H, W] in [0, 1]: how frontally the best photo saw a place; 1 where no cameras are
        known.
    """

    atlas: Atlas
    landmarks: Float64
    pixels: float
    hair: Float32 | None
    clothes: Float32
    ears: Float32
    seen: Float32

    @staticmethod
    def of(field: VoxelField, landmarks: NDArray[np.floating], cameras: Camera | None = None,
           pixels: float = PIXELS, networks: bool = True) -> Skin:
        """The skin of a field.

        Parameters
        ----------
        field
            In the portrait frame.
        landmarks
            float64 [68, 3].
        cameras
            Of the photos, to know which places they saw.
        pixels
            Pixels of the charts per world unit.
        networks
            Ask the segmentation network for hair, where its weights are at hand.

        Raises
        ------
        UserError
            If the field shows no surface.
        """
        points = np.asarray(landmarks, np.float64)
        atlas = draw_atlas(field, pixels)
        seen = _seen(atlas, cameras)
        hair = _hair(atlas) if networks else None
        if hair is not None and not _plausible(atlas, points, hair * seen):
            hair = None
        return Skin(atlas, points, pixels, hair, _clothes(atlas, points, hair, pixels),
                    _ears(atlas, points), seen)


def _chart_slices(atlas: Atlas, n: int) -> tuple[slice, slice]:
    x0, y0, x1, y1, dx, dy = (int(value) for value in atlas.boxes[n])
    return slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)


def _hair(atlas: Atlas) -> Float32 | None:
    """Hair on the upright charts by the network; other charts take it from them by cells."""
    from ... import models
    from ...face import hair_mask

    if models.missing(["hair-segmentation"]):
        return None
    out = np.full(atlas.depth.shape, np.nan, np.float32)
    pitch = np.degrees(np.arcsin(np.clip(
        -atlas.cameras.pose[:, 1, 2], -1, 1)))
    for n in range(len(atlas.cameras)):
        if abs(pitch[n]) > UPRIGHT:
            continue
        part = _chart_slices(atlas, n)
        there = np.isfinite(atlas.depth[part])[..., None]
        picture = np.where(there, atlas.color[part], np.float32(0.75))
        rows, columns = picture.shape[:2]
        side = max(rows, columns)
        square = np.full((side, side, 3), 191, np.uint8)
        top, left = (side - rows) // 2, (side - columns) // 2
        square[top:top + rows, left:left + columns] = np.uint8(picture * 255 + 0.5)
        out[part] = hair_mask(square, size=384)[top:top + rows, left:left + columns]
    return _spread(atlas, out)


def _plausible(atlas: Atlas, landmarks: Float64, hair: Float32) -> bool:
    """Whether a good part of the head above the brows is hair: else it is shaven, or a statue."""
    with np.errstate(invalid="ignore"):
        above = atlas.own & (atlas.points[..., 1] > float(np.nanmean(landmarks[17:27, 1])))
    return bool(above.any() and hair[above].mean() > 0.2)


def _spread(atlas: Atlas, values: Float32) -> Float32:
    """Fill the surface's NaN in values [H, W] with means of the cells of space around."""
    surface = np.isfinite(atlas.depth)
    shape = atlas.shape
    cells = np.nan_to_num((np.nan_to_num(atlas.points) - shape.low) / shape.cell).astype(np.int64)
    size = np.array(shape.normals.shape[:3])
    index = np.ravel_multi_index(tuple(np.clip(cells[..., 2 - axis], 0, size[axis] - 1)
                                       for axis in range(3)), tuple(size))
    known = surface & np.isfinite(values)
    total, count = (np.bincount(index[known], weight, int(size.prod())).reshape(size)
                    .astype(np.float32) for weight in (values[known].astype(np.float64), None))
    for axis in range(3):
        total, count = (gaussian_blur_1d(grid, axis) for grid in (total, count))
    mean = (total / np.maximum(count, 1e-6)).reshape(-1)
    out = np.where(surface & ~known, mean[index], np.nan_to_num(values))
    return np.asarray(np.where(surface, out, 0.0), np.float32)


def gaussian_blur_1d(grid: Float32, axis: int) -> Float32:
    """A grid smoothed by one cell along an axis."""
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(grid, 1.0, axis=axis, truncate=3.0), np.float32)


def skin_distance(image: NDArray[np.floating], face: NDArray[np.bool_]) -> Float32:
    """How far colours are from those of the face, in standard deviations, float32 [H, W].

    Parameters
    ----------
    image
        float [H, W, 3], sRGB in [0, 1].
    face
        bool [H, W], skin of the face.

    Shading counts for little, hue and chroma for much.
    """
    from skimage.color import rgb2lab

    values = rgb2lab(np.clip(image, 0, 1)).astype(np.float32) * np.float32([0.4, 1.0, 1.0])
    if face.sum() < 50:
        return np.zeros(image.shape[:2], np.float32)
    sample = values[face]
    spread = np.cov(sample.T) + np.diag([9.0, 9.0, 9.0])
    away = (values - np.median(sample, axis=0)).reshape(-1, 3)
    root = np.linalg.cholesky(np.linalg.inv(spread))
    return np.asarray(np.sqrt(((away @ root) ** 2).sum(axis=1)), np.float32).reshape(
        image.shape[:2])


def _clothes(atlas: Atlas, landmarks: Float64, hair: Float32 | None, pixels: float) -> Float32:
    """What lies below the chin, is no hair, and is not of the colour of the cheeks."""
    brows = float(np.nanmean(landmarks[17:27, 1]))
    chin = float(np.nanmin(landmarks[:, 1]))
    height = max(brows - chin, 1e-3)
    depth = (brows - atlas.points[..., 1]) / np.float32(height)
    own = atlas.own
    with np.errstate(invalid="ignore"):
        front = own & (np.abs(atlas.points[..., 0]) < 0.6 * height) & (atlas.points[..., 2] > 0)
        face = front & (depth > 0.3) & (depth < 0.95)
        below = np.clip((depth - 1.0) / 0.15, 0, 1)
    away = skin_distance(atlas.color, face)
    other = 1 / (1 + np.exp(np.clip((3.5 - away) / 0.5, -30, 30)))
    share = np.nan_to_num(other * below)
    if hair is not None:
        share = share * (1 - hair)
    return gaussian_blur(np.asarray(share, np.float32), 0.01 * pixels)


def _ears(atlas: Atlas, landmarks: Float64) -> Float32:
    """Soft ellipsoids at the ends of the jaw, from the brows to the nose's foot."""
    out = np.zeros(atlas.depth.shape, np.float32)
    brows, foot = float(np.nanmean(landmarks[17:27, 1])), float(np.nanmean(landmarks[31:36, 1]))
    height = brows - float(np.nanmin(landmarks[:, 1]))
    for end, side in ((0, -1.0), (16, 1.0)):
        if not np.isfinite(landmarks[end]).all():
            continue
        middle = np.array([landmarks[end, 0] + 0.05 * side * height, 0.4 * brows + 0.6 * foot,
                           landmarks[end, 2] - 0.3 * height])
        reach = height * np.array([0.24, 0.28, 0.22])
        with np.errstate(invalid="ignore"):
            away = np.sqrt((((atlas.points - middle) / reach) ** 2).sum(-1))
            out = np.fmax(out, np.clip((1.15 - away) / 0.2, 0, 1))
    return np.asarray(np.nan_to_num(out), np.float32)


def _seen(atlas: Atlas, cameras: Camera | None) -> Float32:
    """How frontally the best of the cameras saw each place, by the large shape alone."""
    if cameras is None or not len(cameras):
        return np.ones(atlas.depth.shape, np.float32)
    coarse = atlas.points[::4, ::4]
    normals = atlas.shape.at(coarse)
    best = np.full(coarse.shape[:2], -1.0, np.float32)
    for position in cameras.position[::max(1, len(cameras) // 40)]:
        towards = position.astype(np.float32) - coarse
        towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
        best = np.fmax(best, (towards * normals).sum(-1))
    share = np.clip((np.nan_to_num(best, nan=-1.0) - 0.1) / 0.3, 0, 1)
    height, width = atlas.depth.shape
    return np.ascontiguousarray(np.repeat(np.repeat(share, 4, 0), 4, 1)[:height, :width],
                                np.float32)
