"""Speed-ups for videos: a resized exemplar, and frames carried on from earlier ones.

A painted frame knows for each pixel which shift from the anchor plane to the exemplar it copies
with. The anchor plane goes on with the flow, and so may the shifts: the next frame then copies the
same strokes from their new places, as sharply as if it were painted from scratch, without guides,
seeds and chunks. Where a frame shows what the one before did not, the guided place of that one
serves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..exemplar import Exemplar
from ..guides.color_segmentation import resize
from ..guides.position import anchor_scale
from ..guides.regions import Regions
from ..kernels.video import carry_shifts
from ..kernels.vote import blend, vote
from ..styleblit import shift_planes
from ..transfers import Transfer, TransferResult
from .motion import Motion

__all__ = ["paint_onward", "reduced"]

Float32 = NDArray[np.float32]


def reduced(prepared: Transfer, factor: float) -> Transfer:
    """The same painting, ``factor`` times smaller.

    Where a target's pixel covers several of the exemplar's, as in many videos, what is copied then
    lies closer together: that saves a third of the look-ups' time.
    """
    image, own = prepared.exemplar.image, prepared.regions
    height, width = (max(8, round(n / factor)) for n in image.shape[:2])
    picture = np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.LANCZOS))
    ratio = np.array([width, height]) / image.shape[1::-1]
    exemplar = Exemplar(picture, prepared.exemplar.landmarks * ratio, prepared.exemplar.name)
    regions = Regions(exemplar.landmarks, resize(own.person, picture.shape),
                      None if own.hair is None else resize(own.hair, picture.shape))
    chunks = prepared.config.blit
    levels = max(1, chunks.levels - round(np.log2(factor)))
    config = replace(prepared.config, blit=replace(chunks, levels=levels))
    return Transfer(exemplar, config, regions=regions, exact=True)


def paint_onward(prepared: Transfer, frame: NDArray[np.uint8], landmarks: NDArray[np.float64],
                 person: Callable[[], Float32], anchor: Float32, motion: Motion,
                 kept: NDArray[np.bool_], before: TransferResult) -> TransferResult:
    """Paint a frame with the shifts of the one before.

    Parameters
    ----------
    prepared
        The exemplar.
    frame, landmarks
        uint8 [H, W, 3] and [68, 2].
    person
        Gives the person's mask, float32 [H, W], if it is needed.
    anchor
        float32 [H, W, 2].
    motion, kept
        From the frame before; bool [h, w], blocks whose anchors came from there.
    before
        What the frame before was painted with.

    Returns
    -------
    The result; its guides other than the anchor are those of the frame before.
    """
    config, guides = prepared.config.blit, before.guides
    height, width = frame.shape[:2]
    margin = max(config.radius, 1)
    shift = shift_planes(height, width, margin)
    inside = np.moveaxis(shift[:, margin:margin + height, margin:margin + width], 0, -1)
    carry_shifts(before.synthesis.shift, motion.back, motion.factor, kept, guides.position, anchor,
                 inside)
    image = np.empty((height, width, 3), np.float32)
    pitch = anchor_scale(anchor)
    reach = np.float32((3 * config.radius + 2) * pitch)
    vote(prepared.colors(pitch), anchor, reach, shift, margin, config.radius, False,
         image)
    result, cover = image, before.mask
    if not prepared.covers_all:
        cover = prepared.cover(frame, landmarks, person())
        result = np.empty_like(image)
        blend(frame, np.float32(1 / 255), image, cover, result)
    return replace(before, image=result, guides=replace(guides, anchor=anchor), mask=cover,
                   synthesis=replace(before.synthesis, image=image, shift=inside))
