"""Control points of the position guide: landmarks, and where rays meet hairline and outline."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .guides import mls_similarity
from .regions import RAYS, Regions

__all__ = ["match_regions"]

Float64 = NDArray[np.float64]


def match_regions(landmarks: Float64, regions: Regions, style_landmarks: Float64,
                  style_regions: Regions,
                  contours: bool = True) -> tuple[Float64, Float64, Float64, Float64]:
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
    if contours:
        for name, weight in (("outline", 2.0), ("hairline", 1.0)):
            sources.append(getattr(regions, name)())
            targets.append(getattr(style_regions, name)())
            weights.append(np.full(len(RAYS), weight))
        foot, style_foot = _foot(landmarks, regions, style_landmarks, style_regions)
        sources.append(foot)
        targets.append(style_foot)
        weights.append(np.full(len(foot), 2.0))
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
