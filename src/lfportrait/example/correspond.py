"""Control points of the position guide: landmarks, and where rays meet hairline and outline.

Neck and body, where there are none, are laid onto the exemplar's by their edges.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from .guides import mls_similarity
from .regions import RAYS, Regions

__all__ = ["lay_body", "match_regions"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

LINES = 12
"""Lines across neck and body on which the edges are looked for."""
BELOW = 1.02, 1.27
"""Depths below the brows (the chin is 1) between which the face gives way to the body."""


def match_regions(landmarks: Float64, regions: Regions, style_landmarks: Float64,
                  style_regions: Regions, contours: bool = True,
                  foot: bool = True) -> tuple[Float64, Float64, Float64, Float64]:
    """Control points of the position guide: landmarks, hairline, outline and the lower border.

    The latter not without ``foot``: `lay_body` does more.

    Returns
    -------
    sources, targets
        [M, 2] in the target and in the exemplar; only points known on both sides count.
    weights, softness
        [M], see `guides.mls_similarity`.
    """
    sources, targets = [landmarks], [style_landmarks]
    weights = [np.ones(68)]
    if contours:
        for name, weight in (("outline", 2.0), ("hairline", 1.0)):
            sources.append(getattr(regions, name)())
            targets.append(getattr(style_regions, name)())
            weights.append(np.full(len(RAYS), weight))
        if foot:
            lowest, style_lowest = _foot(landmarks, regions, style_landmarks, style_regions)
            sources.append(lowest)
            targets.append(style_lowest)
            weights.append(np.full(len(lowest), 2.0))
    source = np.concatenate(sources)
    softness = np.full(len(source), 0.05 * regions.frame.height)
    softness[:68] = 0.0
    return source, np.concatenate(targets), np.concatenate(weights), softness


def _foot(landmarks: Float64, regions: Regions, style_landmarks: Float64,
          style_regions: Regions) -> tuple[Float64, Float64]:
    """Points on the target's lower border, pinned to the exemplar's where it shows less body.

    Without them a photo that shows more of the chest than the exemplar does would run off its lower
    border. Where the exemplar shows enough there are none.
    """
    height, width = regions.person.shape
    style_height = style_regions.person.shape[0]
    foot = np.array([[0.0, height], [width / 2, height], [float(width), height]])
    style_foot = mls_similarity(foot, landmarks[:27], style_landmarks[:27])
    beyond = style_foot[:, 1] > style_height - 1
    style_foot[:, 1] = style_height - 1
    return foot[beyond], style_foot[beyond]


def lay_body(nodes: Float32, grid: int, regions: Regions, style_regions: Regions) -> None:
    """Lay neck and body onto those of the exemplar, in place.

    The landmarks end at the chin, and a turned head lies beside its neck. So below the chin a place
    is matched by how far down it is, and by where it lies between the left and the right edge of
    the body; beside the body, by how far it is from the edge. Where the exemplar shows less below
    the chin than the target does, that is spread over all of it.

    Parameters
    ----------
    nodes
        float32 [h, w, 2], places in exemplar pixels of every ``grid``-th target pixel.
    grid
        In pixels.
    regions, style_regions
        Of the target and of the exemplar.
    """
    frame, style_frame = regions.frame, style_regions.frame
    lowest, style_lowest = regions.lowest(), style_regions.lowest()
    first, last = BELOW
    places = np.moveaxis(np.indices(nodes.shape[:2], np.float64), 0, -1)[..., ::-1] * grid + 0.5
    local = (places - frame.origin) / frame.height
    right, down = local @ frame.right, local @ frame.down
    below = down > first
    if not below.any():
        return
    right, down = right[below], down[below]
    depths = np.linspace(first, max(lowest, last), LINES)
    shrink = min(1.0, (style_lowest - first) / max(lowest - first, 1e-6))
    style_depths = first + shrink * (depths - first)
    spans, style_spans = _spans(regions, depths), _spans(style_regions, style_depths)
    left, end, style_left, style_end = (
        np.interp(down, depths, spans[:, n])
        for spans in (spans, style_spans) for n in (0, 1))
    beyond = np.maximum(right - end, 0) + np.minimum(right - left, 0)
    share = np.clip((right - left) / (end - left), 0, 1)
    across = style_left + share * (style_end - style_left) + beyond
    laid = style_frame.point(across, first + shrink * (down - first))
    blend = np.clip((down - first) / (last - first), 0, 1)
    blend = (blend * blend * (3 - 2 * blend))[:, None]
    nodes[below] += blend * (laid - nodes[below])


def _spans(regions: Regions, depths: Float64) -> Float64:
    """Left and right edge of the body at some depths, smoothed along them, [D, 2]."""
    return gaussian_filter1d(regions.spans(depths), 1.0, axis=0, mode="nearest")
