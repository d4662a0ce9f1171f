"""A painted hat, put on the sitter of a photo.

It lies over the picture as a thing with its own edge, warped by the two faces' frames: as wide as
the sitter's face is against the painter's, and high enough for the sitter's head. Hair that would
stick out above its edge is pressed down under it: there is background.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..exemplar import Exemplar
from ..guides.filters import grey
from ..guides.regions import Regions, soft_face
from .hat import headwear

__all__ = ["Hat", "Layer"]

Float32 = NDArray[np.float32]
Bools = NDArray[np.bool_]

CROWN, ROOM = 0.85, 0.06
"""A head without its hair ends this far above the brows (chin -1) at most, a hat so far above."""
HIGHER = 1.5
"""A hat is made higher by this factor at most."""
JOINED = 0.3
"""The map below the brows goes over into the one above them within so much of the face's height."""
SHADE, DEEPEST = 0.12, 0.45
"""Its shade reaches so far below its edge, over the face's height, and takes at most this share of
the light."""
REACHES = 0.05, 0.15, 0.4, 1.2
"""Background is carried in under removed hair from as far as this, over the face's height."""
SOFT = 0.015
"""Removed hair ends softly over so much of the face's height."""
FINER = 1.2
"""A hat with so many of its pixels per pixel of the photo is made smaller first."""


@dataclass(frozen=True)
class Layer:
    """A hat as it lies over a photo.

    Attributes
    ----------
    color
        float32 [H, W, 3] in [0, 1], sRGB.
    cover
        float32 [H, W] in [0, 1], where it lies.
    light
        float32 [H, W] in [0, 1], what its shade leaves of the light below it.
    """

    color: Float32
    cover: Float32
    light: Float32

    def over(self, image: Float32) -> Float32:
        """A picture [H, W, 3] with it."""
        shaded = image * self.light[..., None]
        return np.asarray(shaded + self.cover[..., None] * (self.color - shaded), np.float32)


class Hat:
    """The hat of a painting's sitter.

    Parameters
    ----------
    exemplar
        The painting as its sitter wears it.
    mask
        float32 [h, w] in [0, 1], the hat (`headwear`).
    regions
        Of the painting.
    """

    def __init__(self, exemplar: Exemplar, mask: Float32, regions: Regions) -> None:
        self.frame, self.mask = regions.frame, mask
        self.color = _carried_beyond(exemplar.image.astype(np.float32) / np.float32(255), mask,
                                     regions.frame.height)
        self.shade = _shade(exemplar, mask, regions)
        right, down = regions.frame.local(mask.shape)
        half = 0.5 * regions.frame.width / regions.frame.height
        middle = (mask > 0.5) & (np.abs(right) < 0.3 * half)
        self.top = float(-down[middle].min()) if middle.any() else CROWN

    @staticmethod
    def of(exemplar: Exemplar, regions: Regions) -> Hat | None:
        """The hat of a painting, bared or not, with its regions; None if there is none."""
        covered = exemplar.covered
        if covered is not None:
            exemplar, regions = covered, covered.regions()
        mask = headwear(exemplar, regions)
        return None if mask is None else Hat(exemplar, mask, regions)

    def put_on(self, photo: NDArray[np.generic], regions: Regions,
               ) -> tuple[NDArray[np.generic], Regions, Layer]:
        """The hat on a photo's sitter.

        Parameters
        ----------
        photo
            uint8 or float in [0, 1], [H, W, 3].
        regions
            Of the photo.

        Returns
        -------
        photo, regions
            Without what sticks out above the hat.
        layer
            The hat.
        """
        shape = photo.shape[0], photo.shape[1]
        right, down = regions.frame.local(shape)
        color, cover = self._warped(right, down, regions)
        gone = _sticking_out(cover, regions.person, down)
        soft = cv2.GaussianBlur(gone.astype(np.float32), (0, 0),
                                max(0.5, SOFT * regions.frame.height))
        gone_soft = np.maximum(gone, np.clip(2 * soft, 0, 1)).astype(np.float32)
        person = np.asarray(regions.person * (1 - gone_soft), np.float32)
        hair = None if regions.hair is None else np.asarray(regions.hair * (1 - gone_soft),
                                                            np.float32)
        before = np.asarray(photo, np.float32)
        behind = _carried_beyond(before, np.clip(1 - 2 * np.maximum(regions.person, cover), 0, 1),
                                 regions.frame.height)
        mixed = before + gone_soft[..., None] * (behind - before)
        if photo.dtype == np.uint8:
            mixed = np.clip(mixed + 0.5, 0, 255)
        layer = Layer(color, cover, self._light(cover, regions, right, down))
        return np.asarray(mixed, photo.dtype), Regions(regions.landmarks, person, hair), layer

    def _warped(self, right: Float32, down: Float32, regions: Regions) -> tuple[Float32, Float32]:
        """Colors [H, W, 3] and cover [H, W] of the hat at places in the photo's face frame."""
        ours, theirs = self.frame, regions.frame
        wide = (ours.width / ours.height) / (theirs.width / theirs.height)
        above = wide / self._higher(regions, wide)
        share = np.clip(-down / JOINED, 0, 1)
        share = share * share * (3 - 2 * share)
        places = (right * wide)[..., None] * ours.right + (
            down * (1 + share * (above - 1)))[..., None] * ours.down
        places = np.asarray(ours.origin + ours.height * places, np.float32)
        step = ours.height * wide / theirs.height
        planes = np.concatenate([self.color, self.mask[..., None]], axis=-1)
        if step > FINER:
            size = tuple(max(round(side / step), 8) for side in self.mask.shape[::-1])
            places *= np.divide(size, self.mask.shape[::-1], dtype=np.float32)
            planes = cv2.resize(planes, size, interpolation=cv2.INTER_AREA)
        x, y = (np.ascontiguousarray(places[..., axis]) - np.float32(0.5) for axis in range(2))
        # What the painting's border cuts off ends there.
        color = cv2.remap(np.ascontiguousarray(planes[..., :3]), x, y, cv2.INTER_CUBIC,
                          borderMode=cv2.BORDER_REPLICATE)
        cover = cv2.remap(np.ascontiguousarray(planes[..., 3]), x, y, cv2.INTER_LINEAR,
                          borderMode=cv2.BORDER_CONSTANT, borderValue=0.0)
        return (np.asarray(np.clip(color, 0, 1), np.float32),
                np.asarray(np.clip(cover, 0, 1), np.float32))

    def _higher(self, regions: Regions, wide: float) -> float:
        """How much higher it is to be, so that it covers a sitter's crown."""
        outline = regions.outline(np.zeros(1))[0] - regions.frame.origin
        head = float(-outline @ regions.frame.down) / regions.frame.height
        head = CROWN if not np.isfinite(head) else head
        # Hair is pressed down.
        head = head if regions.hair is None else min(head, CROWN)
        return float(np.clip((head + ROOM) * wide / max(self.top, 1e-3), 1.0, HIGHER))

    def _light(self, cover: Float32, regions: Regions, right: Float32, down: Float32) -> Float32:
        """What its shade leaves of the light on the forehead, [H, W]."""
        height = regions.frame.height
        sigma = max(0.5, 0.5 * SHADE * height)
        shift = np.float32(SHADE * height / 3) * regions.frame.down
        moved = cv2.warpAffine(cover, np.array([[1, 0, shift[0]], [0, 1, shift[1]]]),
                               cover.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
        near = cv2.GaussianBlur(moved, (0, 0), sigma)
        half = 0.5 * regions.frame.width / height
        # It falls on the person, below the hat alone.
        where = regions.person * np.clip((1.3 - np.abs(right) / half) / 0.3, 0, 1) * (
            np.clip((0.6 - down) / 0.6, 0, 1))
        return np.asarray(1 - self.shade * near * where, np.float32)


def _carried_beyond(image: Float32, known: Float32, height: float) -> Float32:
    """Colors [h, w, 3] where they are known [h, w], and from the nearest such places elsewhere."""
    step = max(1, int(height / 60))
    size = tuple(max(side // step, 4) for side in image.shape[1::-1])
    weight = np.asarray(cv2.resize(known, size, interpolation=cv2.INTER_AREA), np.float32)
    colors = cv2.resize(image * known[..., None], size, interpolation=cv2.INTER_AREA)
    total = max(float(weight.sum()), 1e-6)
    out = np.broadcast_to(colors.sum(axis=(0, 1)) / total, colors.shape).astype(np.float32)
    for reach in reversed(REACHES):
        sigma = max(0.5, reach * height / step)
        found = cv2.GaussianBlur(weight, (0, 0), sigma)[..., None]
        here = cv2.GaussianBlur(colors, (0, 0), sigma) / (found + 1e-6)
        out += np.clip(found / 0.05, 0, 1) * (here - out)
    broad = cv2.resize(out, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    sure = np.clip(2 * known - 1, 0, 1)[..., None]
    return np.asarray(broad + sure * (image - broad), np.float32)


def _shade(exemplar: Exemplar, mask: Float32, regions: Regions) -> float:
    """How much darker the face is painted right below its hat than the cheeks are, in [0, 1]."""
    height = regions.frame.height
    _, down = regions.frame.local(mask.shape)
    side = 2 * max(1, round(SHADE * height)) + 1
    near = cv2.dilate((mask > 0.5).astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    soft = soft_face(mask.shape, exemplar.landmarks, 0.4) > 200
    light = grey(exemplar.image)
    below, cheeks = (light[soft & part & (mask < 0.1)] for part in (
        near & (down < -0.1), (down > 0.15) & (down < 0.6)))
    if min(len(below), len(cheeks)) < 30:
        return 0.0
    share = float(np.median(below)) / max(float(np.median(cheeks)), 1e-3)
    return float(np.clip(1 - share, 0, DEEPEST))


def _sticking_out(cover: Float32, person: Float32, down: Float32) -> Bools:
    """The part of a person [H, W] above a hat's edge that the hat does not cover."""
    rows = np.arange(len(cover))[:, None]
    worn = (cover > 0.5) & (down < 0)
    if not worn.any():
        return np.zeros(cover.shape, bool)
    lowest = np.where(worn, rows, -1).max(axis=0)
    columns = np.flatnonzero(lowest >= 0)
    # Beyond its sides the level of its ends goes on.
    level = np.interp(np.arange(cover.shape[1]), columns, lowest[columns])
    return (rows < level) & (cover < 0.5) & (person > 0.02)
