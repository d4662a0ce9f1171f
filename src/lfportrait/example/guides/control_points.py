"""Control points of the position guide: landmarks, and where rays meet hairline and outline.

Below the chin there are none: a neck is made longer, or neck and body are laid onto the exemplar's
by their edges.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from .regions import RAYS, Regions

__all__ = ["lay_body", "lengthen_neck", "match_regions", "plain_neck"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

LINES = 12
"""Lines across neck and body on which the edges are looked for."""
BELOW = 1.02, 1.27
"""Depths below the brows (the chin is 1) between which the face gives way to the body."""

UNDER_CHIN, LOWEST_NECK = 0.015, 0.1
"""The neck's plainest strip begins so far below the chin, over the face's height."""
STRIP = 0.15
"""Its height over what the exemplar shows below it."""


def match_regions(landmarks: Float64, regions: Regions, style_landmarks: Float64,
                  style_regions: Regions) -> tuple[Float64, Float64, Float64, Float64]:
    """Control points of the position guide: landmarks, hairline and outline.

    Returns
    -------
    sources, targets
        [M, 2] in the target and in the exemplar; only points known on both sides count.
    weights, softness
        [M], see `guides.mls_similarity`.
    """
    sources, targets = [landmarks], [style_landmarks]
    weights = [np.ones(68)]
    for name, weight in (("outline", 2.0), ("hairline", 1.0)):
        sources.append(getattr(regions, name)())
        targets.append(getattr(style_regions, name)())
        weights.append(np.full(len(RAYS), weight))
    source = np.concatenate(sources)
    softness = np.full(len(source), 0.05 * regions.frame.height)
    softness[:68] = 0.0
    return source, np.concatenate(targets), np.concatenate(weights), softness


def plain_neck(picture: Float32, landmarks: Float64) -> tuple[float, float]:
    """The plainest strip of an exemplar's neck: first and last row, in pixels below the chin.

    Parameters
    ----------
    picture
        float32 [h, w], grey.
    landmarks
        [68, 2] of the exemplar.
    """
    height = float(landmarks[8, 1] - landmarks[17:27, 1].mean())
    chin, half = landmarks[8], 0.15 * height
    left, right = (int(np.clip(chin[0] + side * half, 0, picture.shape[1])) for side in (-1, 1))
    rows = np.asarray(picture[int(max(chin[1], 0)):, left:right], np.float64)
    shown = len(rows) - 2.0
    if right - left < 2 or shown < 8:
        return 0.0, max(shown, 1.0)
    change = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(rows, axis=0)).mean(axis=1))])
    # The line below the chin belongs to the face.
    least = int(min(UNDER_CHIN * height, 0.5 * shown))
    first = np.arange(least, max(int(min(LOWEST_NECK * height, 0.6 * shown)), least + 1))
    last = np.minimum(first + STRIP * (shown - first), shown).astype(np.int64)
    # The lower the strip, the sooner it cuts a collar.
    cost = (change[last] - change[first]) / np.maximum(last - first, 1) * (1 + first / height * 10)
    best = int(np.argmin(cost))
    return float(first[best]), float(last[best])


def lengthen_neck(nodes: Float32, chin: float, style_height: int,
                  neck: tuple[float, float], scale: float, grid: int) -> None:
    """Keep the target's lower border on the exemplar's where it shows more of the chest, in place.

    Else the guide would run off the exemplar's lower border. What it shows above the border moves
    as one, so that collars and shoulders stay whole; what is missing is made up for below the chin,
    where the neck is plain. Nothing changes where the exemplar shows enough.

    Parameters
    ----------
    nodes
        float32 [h, w, 2], places in exemplar pixels of every ``grid``-th target pixel.
    chin
        Row of the target's chin.
    style_height, neck
        Of the exemplar, in pixels; see `plain_neck`.
    scale
        Exemplar pixels per target pixel.
    """
    below = (np.arange(nodes.shape[0]) * grid + 0.5 - chin) * scale
    beyond = np.maximum(nodes[-1, :, 1] - np.float32(style_height - 2), 0)
    longer = neck[1] - neck[0] + float(beyond.max(initial=0))
    ramp = np.clip((below - neck[0]) / max(longer, 1.0), 0.0, 1.0)
    nodes[..., 1] -= beyond * ramp[:, None].astype(np.float32)


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
