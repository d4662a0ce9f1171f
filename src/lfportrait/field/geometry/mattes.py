"""Mattes that all photos agree on: outlines of the field, or of a solid, along each photo's edges.

A matte that a network or a rough solid gave errs here and there by a few pixels, each photo at
other places. A field that is trained roughly has already weighed all of them: rendered into a
photo, its opacity is right within a pixel or two of its own nearly everywhere, and the photo's
edges say the rest (`refined_mattes`, `lfportrait.capture.refine_matte`). Held-out photos, whose
mattes erred alike, get theirs in the same way, from a field that never saw them.

Where a network's mattes contradict each other, the photos themselves define the object: a solid
from the depth of the training photos (`fused_depth`) is outlined in every photo, and each outline
is laid along that photo's own edges (`cut_out`). Held-out photos are cut in the same way; no depth
is taken from them, and no field is asked. Where the mattes agree, the same solid shows what in them
lies far from the person (`trim`).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...arrays import Float32, UInt8
from ...capture import Capture, holes_of, refine_matte
from ...progress import Progress
from ...simd.threads import side_by_side
from ..grid import VoxelField
from .fused_depth import REACH, Solid, find_solid
from .sweep import sweep_depth

Plane = Float32

_AGREE = 0.8
"""Overlap with a rough outline below which a photo's edges are not followed."""


def along_edges(image: UInt8, coarse: Plane, cell: int) -> tuple[Plane, bool]:
    """Lay a rough matte, right within a few cells, along its photo's edges.

    The photo is uint8 [H, W, 3], mattes float32 [H, W] in [0, 1]; ``cell`` as for `refine_matte`.
    Also whether the edges agree with the rough matte; where they do not, the matte is that itself,
    steeper.
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
    """Mattes uint8 [H, W] of photos, from a field that was trained with rougher ones.

    A photo's own where its edges contradict the field; what is behind the person must be known.
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


_OUTLINE = 256  # height or width in which outlines are drawn
_FEW = 48  # photos whose depth is enough to see what lies far from the object
_ALIKE = 0.75  # overlap with the outline from which a matte is thought to show the same


def cut_out(capture: Capture, mattes: Sequence[NDArray[np.floating[Any]]],
            progress: Progress | None = None) -> list[Plane] | None:
    """Cut the object at the origin out of photos by its geometry: float32 [H, W] in [0, 1] each.

    Of a network's mattes many may be wrong. None where the photos show no object at the origin
    (`find_solid`).
    """
    solid = _solid(capture, mattes, progress)
    if solid is None:
        return None
    if progress is not None:
        progress.update(0, "cutting out the object: outlines")
    outlines = [_coarse(capture, view, solid) for view in range(len(capture))]
    with ThreadPoolExecutor(2) as workers:
        results = list(workers.map(_cut, capture.images, outlines))
    without = [capture.names[view] for view, coarse in enumerate(outlines) if coarse.max() < 0.5]
    if without:
        warnings.warn(f"{len(without)} of {len(capture)} photos do not show the object and are "
                      f"ignored: {_listed(without)}", stacklevel=2)
    plain = [capture.names[view] for view, (_, follows) in enumerate(results) if not follows]
    if plain:
        warnings.warn(f"the edges of {len(plain)} of {len(capture)} photos contradict the shape of "
                      f"the object; its own outline is used there: {_listed(plain)}",
                      stacklevel=2)
    return [matte for matte, _ in results]


def _listed(names: list[str]) -> str:
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")


def trim(capture: Capture, mattes: Sequence[NDArray[np.floating[Any]]],
         progress: Progress | None = None) -> list[Plane]:
    """Remove from mattes, most of them right, what is far from the object by the photos' depth.

    Of [H, W] in [0, 1]; float32. One that the object's outline does not resemble stays as it is,
    and all do where the photos show no object. What changes is not along the photo's edges
    (`lfportrait.capture.refine_changes`).
    """
    given = [np.asarray(matte, np.float32) for matte in mattes]
    solid = _solid(capture, given, progress, _FEW)
    if solid is None:
        return given

    def trimmed(view: int, distance: Plane) -> Plane:
        matte = given[view]
        person, inside = matte > 0.5, distance < 0
        if (person & inside).sum() < _ALIKE * (person | inside).sum():
            return matte
        # Two and a half spacings, 6 mm on a head, are left to hair.
        return np.asarray(matte * np.clip(5.5 - 2.0 * distance / solid.spacing, 0, 1))

    return side_by_side(lambda view: trimmed(view, _outlined(capture, view, solid)),
                        range(len(capture)), most=4)


def _solid(capture: Capture, mattes: Sequence[NDArray[np.floating[Any]]],
           progress: Progress | None, most: int | None = None) -> Solid | None:
    """The object as the training photos show it, or ``most`` of them spread evenly."""
    views = capture.training()
    if most is not None and len(views) > most:
        views = views[np.linspace(0, len(views) - 1, most).astype(int)]
    if progress is not None:
        progress.update(0, "cutting out the object: depth")
    maps = sweep_depth(capture, views, REACH)
    votes = [np.asarray(cv2.resize(np.asarray(mattes[view], np.float32), item.depth.shape[::-1],
                                   interpolation=cv2.INTER_AREA), np.float32)
             for view, item in zip(views, maps)]
    return find_solid(maps, votes)


def _outlined(capture: Capture, view: int, solid: Solid) -> Plane:
    """Distance of the pixels of one photo to the outline, float32 [H, W] (`Solid.outline`)."""
    height, width = capture.images[view].shape[:2]
    camera = capture.cameras[view].scaled(min(1.0, _OUTLINE / max(height, width)))
    distance = solid.outline(camera)
    distance[holes_of(distance < 0)] = -1e-3 * solid.spacing
    return np.asarray(cv2.resize(distance, (width, height), interpolation=cv2.INTER_CUBIC),
                      np.float32)


def _coarse(capture: Capture, view: int, solid: Solid) -> Plane:
    """A coarse matte of one photo, float32 [H, W]: a slope three spacings wide at the outline."""
    return np.asarray(np.clip(0.5 - _outlined(capture, view, solid) / (3.0 * solid.spacing), 0, 1),
                      np.float32)


def _cut(image: UInt8, coarse: Plane) -> tuple[Plane, bool]:
    """The matte laid along the photo's edges, and whether these agree with the outline."""
    return along_edges(image, coarse, max(2, round(max(coarse.shape) / 256)))
