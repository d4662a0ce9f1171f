"""The guides of one target picture, and the mapping of its pixels to the plane of its seeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..kernels.guides import stretch
from .filters import enlarged, gaussian_blur

__all__ = ["Guides", "anchor_scale", "relative_stretch", "sample_labels"]

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
        uint8 [H, W, K], soft region labels (255 = wholly inside), by `PICTURE_LABELS`.
    anchor
        float32 [H, W, 2], the pixel's place in the plane of the seed grid, in exemplar pixels.
    """

    position: Float32
    appearance: Float32
    labels: NDArray[np.uint8]
    anchor: Float32


def sample_labels(labels: NDArray[np.uint8], position: Float32) -> NDArray[np.uint8]:
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


def relative_stretch(position: Float32, anchor: Float32, least: float = 0.1,
                     cell: int = 1) -> Float32:
    """How much slower the position changes than the anchor, float32 [H, W] in [least, 1].

    Where many surface points share a place in the exemplar (the back of a head), the position can't
    ask for more than that: its weight falls in proportion. Only one pixel of each ``cell`` x
    ``cell`` is looked at.
    """
    height, width = position.shape[:2]
    ratio = np.empty((-(-height // cell), -(-width // cell)), np.float32)
    stretch(position, anchor, np.float32(least), cell, ratio)
    return enlarged(gaussian_blur(ratio, 2.0 / cell), cell, (height, width))
