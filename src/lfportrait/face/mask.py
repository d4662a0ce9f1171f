"""The face mask of Shen et al. 2023, Fig. 3: chin line, forehead ellipse, skin color, components.

The jaw's landmarks and an ellipse through its upper ends bound the face without its forehead. The
skin's color is sampled inside, and what continues the face above the brows in that color, in one
connected piece, is forehead; hair and fringe differ and stay out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage
from skimage.draw import polygon2mask

from ..arrays import Bool, Float32, Float64, UInt8

__all__ = ["face_mask"]

FINE = 160
"""Minimum width of the face in blocks of pixels."""


def _chroma(image: NDArray[Any]) -> Float32:
    """Cb and Cr of an sRGB picture (ITU-R BT.601), [H, W, 2], in units of 1/255, and luma."""
    rgb = np.asarray(image, np.float32)
    luma = rgb @ np.array([0.299, 0.587, 0.114], np.float32)
    return np.stack([0.564 * (rgb[..., 2] - luma), 0.713 * (rgb[..., 0] - luma), luma], axis=-1)


def _forehead(landmarks: Float64, reach: float) -> Float64:
    """The upper half of an ellipse on the line between the jaw's ends, turned with the head."""
    left, right = landmarks[0], landmarks[16]
    middle, across = 0.5 * (left + right), 0.5 * (right - left)
    upward = middle - landmarks[8]
    upward = upward - across * (upward @ across) / max(float(across @ across), 1e-9)
    upward /= max(float(np.linalg.norm(upward)), 1e-9)
    face = float(np.linalg.norm(landmarks[8] - middle))
    angle = np.linspace(np.pi, 0, 40)[:, None]
    return middle - across * -np.cos(angle) + upward * np.sin(angle) * reach * face


def face_mask(image: UInt8, landmarks: Float64, *,
              softness: float = 0.02) -> Float32:
    """The soft mask of the face in a photo.

    Parameters
    ----------
    image
        uint8 [H, W, 3], sRGB.
    landmarks
        float64 [68, 2] in pixels.
    softness
        Width of the soft edge (sigma) relative to the face's width.

    Returns
    -------
    mask
        float32 [H, W] in [0, 1].
    """
    jaw = landmarks[:17]
    limit = np.concatenate([jaw, _forehead(landmarks, 0.85)[::-1]])
    # Only the face's surroundings are looked at, by blocks of pixels: the edge is soft anyway.
    width = float(np.linalg.norm(landmarks[16] - landmarks[0]))
    block = max(1, int(width / FINE))
    margin = 4 * softness * width + block
    low = np.maximum(np.floor(limit.min(0) - margin), 0).astype(int) // block * block
    high = np.minimum(np.ceil(limit.max(0) + margin), image.shape[1::-1]).astype(int)
    out = np.zeros(image.shape[:2], np.float32)
    if (high <= low).any():
        return out
    small = np.asarray(Image.fromarray(np.ascontiguousarray(image[..., :3])).reduce(
        block, (int(low[0]), int(low[1]), int(high[0]), int(high[1]))))
    mask = _small_mask(small, (landmarks - low) / block, softness)
    size = small.shape[1] * block, small.shape[0] * block
    full = np.asarray(Image.fromarray(mask).resize(size, Image.Resampling.BILINEAR))
    x, y = low
    out[y:high[1], x:high[0]] = full[:high[1] - y, :high[0] - x]
    return out


def _small_mask(image: UInt8, landmarks: Float64,
                softness: float) -> Float32:
    """`face_mask` of a picture that holds little else."""
    shape = image.shape[:2]

    def filled(outline: Float64) -> Bool:
        # Points are continuous, pixels lie at their middles.
        return polygon2mask(shape, outline[:, ::-1] - 0.5)

    jaw = landmarks[:17]
    width = float(np.linalg.norm(landmarks[16] - landmarks[0]))
    sure = filled(np.concatenate([jaw, _forehead(landmarks, 0.35)[::-1]]))
    limit = filled(np.concatenate([jaw, _forehead(landmarks, 0.85)[::-1]]))
    color = _chroma(image)
    # Skin between brows and mouth, away from eyes and lips, on both sides of its own spread.
    sample = filled(landmarks[[17, 19, 24, 26, 14, 12, 4, 2]])
    for feature in (slice(36, 42), slice(42, 48), slice(48, 60)):
        hull = landmarks[feature]
        grown = hull.mean(0) + 1.6 * (hull - hull.mean(0))
        sample &= ~filled(grown)
    pixels = color[sample] if sample.sum() > 50 else color[sure] if sure.any() else color[:1, 0]
    center = np.median(pixels, axis=0)
    spread = 1.4826 * np.median(np.abs(pixels - center), axis=0)
    spread = np.maximum(spread, np.array([3.0, 3.0, 14.0], np.float32))
    distance = np.abs(color - center) / spread
    skin = (distance[..., 0] < 4.0) & (distance[..., 1] < 4.0) & (distance[..., 2] < 3.5)
    candidate = ndimage.binary_opening((skin & limit) | sure, iterations=max(1, int(width / 120)))
    parts, _ = ndimage.label(candidate)
    wanted = np.unique(parts[sure & candidate])
    face = np.isin(parts, wanted[wanted > 0]) | sure
    face = ndimage.binary_fill_holes(face)
    face = ndimage.binary_closing(face, iterations=max(1, int(width / 60))) & limit | sure
    return np.clip(ndimage.gaussian_filter(face.astype(np.float32), softness * width), 0, 1)
