"""Recompute mattes from the field: the outline all photos agree on, along each photo's edges.

A matte that a network or a rough solid gave errs here and there by a few pixels, each photo at
other places. A field that is trained roughly has already weighed all of them: rendered into a
photo, its opacity is right within a pixel or two of its own nearly everywhere, and the photo's
edges say the rest (`lfportrait.capture.refine_matte`). Held-out photos, whose mattes erred alike,
get theirs in the same way, from a field that never saw them.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ...arrays import UInt8
from ...capture import Capture, refine_matte
from ...simd.threads import side_by_side
from ..grid import VoxelField

__all__ = ["along_edges", "refined_mattes"]

Plane = NDArray[np.float32]

_AGREE = 0.8
"""Overlap with a rough outline below which a photo's edges are not followed."""


def along_edges(image: UInt8, coarse: Plane, cell: int) -> tuple[Plane, bool]:
    """Lay a rough matte along its photo's edges.

    Parameters
    ----------
    image
        uint8 [H, W, 3].
    coarse
        float32 [H, W] in [0, 1], right within a few cells.
    cell
        Pixels to a cell (`lfportrait.capture.refine_matte`).

    Returns
    -------
    matte, follows
        float32 [H, W] in [0, 1], and whether the edges agree with the rough matte; where they do
        not, the matte is that itself, steeper.
    """
    rows, columns = (np.flatnonzero((coarse > 0.02).any(axis=1 - axis)) for axis in (0, 1))
    if not len(rows):
        return coarse, True
    margin = max(coarse.shape) // 24
    box = (slice(max(0, rows[0] - margin), rows[-1] + margin + 1),
           slice(max(0, columns[0] - margin), columns[-1] + margin + 1))
    matte = coarse.copy()
    matte[box] = refine_matte(image[box], coarse[box], cell, calm=True)
    both = ((matte > 0.5) & (coarse > 0.5)).sum()
    either = ((matte > 0.5) | (coarse > 0.5)).sum()
    if both < _AGREE * either:
        return np.clip(2.0 * coarse - 0.5, 0, 1).astype(np.float32), False
    return matte, True


def refined_mattes(field: VoxelField, capture: Capture) -> list[UInt8]:
    """Mattes of photos, from a field that was trained with rougher ones.

    Parameters
    ----------
    field
        The field so far.
    capture
        The photos, with mattes and what is behind the person.

    Returns
    -------
    mattes
        V mattes, uint8 [H, W]; a photo's own where its edges contradict the field.
    """
    assert capture.alphas is not None
    given = capture.alphas
    bricks = field.bricks  # which all views share
    assert len(bricks.links)

    def refined(view: int) -> UInt8:
        matte, follows = along_edges(capture.images[view], *_opacity(field, capture, view))
        return np.asarray(255.0 * matte + 0.5, np.uint8) if follows else given[view]

    return side_by_side(refined, range(len(capture)))


def _opacity(field: VoxelField, capture: Capture, view: int) -> tuple[Plane, int]:
    """The field's opacity in one photo, [H, W], and the photo's pixels to a cell."""
    camera = capture.cameras[view]
    distance = float(np.linalg.norm(camera.position[0] - field.center))
    voxel = float(field.spacing.max()) * float(camera.focal.max()) / distance
    small = field.depth(camera.scaled(min(1.0, 1.0 / voxel)))[0]
    large = cv2.resize(small, capture.images[view].shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.clip(large, 0.0, 1.0).astype(np.float32), max(2, round(0.5 * voxel))
