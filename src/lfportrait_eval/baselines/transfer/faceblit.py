"""FaceBlit as published (Texler et al. 2021), for comparison: 8-bit guides, table, flood fill.

Reimplemented from the publication and from the behaviour of its program, quirks that shape the
picture included: the position guide is a gradient of 256 x 256 steps, the table searches a window
of the exemplar, chunks grow from seeds in scan order, and the skin test of the mask punishes a
chroma below the sample's alone. Two things differ: sizes need not be equal, and places that no
chunk reaches keep the photo instead of arbitrary memory.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage
from skimage.draw import polygon2mask

from lfportrait.arrays import Bool, Float32, Float64, Int32, Int64, UInt8
from lfportrait.example.exemplar import Exemplar
from lfportrait.example.guides.position import pixel_centres, position_guide
from lfportrait.example.styleblit import elect, pack_colors, shift_planes, vote

from ..config import FaceBlitConfig, Painted
from ..kernels import NOWHERE, flood, search_windows, sweep_windows

THRESHOLD, GROUND_THRESHOLD = 50, 10
"""Largest guide error inside a chunk of the face, and of the rest; all as published."""
POSITION, APPEARANCE = 10, 2
"""Weights of one step (1/256 of the picture) of the position, and of one grey level."""
WINDOW = 30
"""Search window of the table: exemplar pixels to each side of a cell's place."""
RADIUS = 1
"""Voting window: 0 none, 1 is 3 x 3, 2 is 5 x 5."""
MASK_BLUR = 20
"""Side in pixels of the box that softens the mask of the face."""
STEPS = 256
"""Steps of the position guide along each axis, and of the appearance."""


def appearance_levels(image: UInt8) -> Int32:
    """Half of grey minus its blur, about 128; the blur is three halvings, enlarged bilinearly."""
    grey = np.asarray(Image.fromarray(image).convert("L"))
    small = grey
    for _ in range(3):
        smooth = small.astype(np.float32)
        for axis in (0, 1):
            smooth = ndimage.convolve1d(smooth, np.array([1, 4, 6, 4, 1]) / 16, axis, mode="mirror")
        small = (smooth[::2, ::2] + 0.5).astype(np.uint8)
    size = grey.shape[1], grey.shape[0]
    blur = np.asarray(Image.fromarray(small).resize(size, Image.Resampling.BILINEAR))
    return ((grey.astype(np.int32) - blur) / 2 + 128).astype(np.int32)


def stretched(levels: Int32) -> Int32:
    """Levels stretched to the full range, symmetrically about 128."""
    reach = max(int(np.abs(levels - 128).max()), 1)
    return np.clip(np.rint(128 + (levels - 128) * (127 / reach)), 0, 255).astype(np.int32)


def matched_levels(levels: Int32, reference: Int32) -> Int32:
    """Levels mapped so that their histogram follows that of ``reference``, over all pixels."""
    own, wanted = (np.rint(255 * np.cumsum(np.bincount(values.ravel(), minlength=256))
                           / values.size) for values in (levels, reference))
    table = np.abs(wanted[None, :] - own[:, None]).argmin(axis=1)
    return np.asarray(table[levels], np.int32)


def gradient(length: int) -> Int32:
    """Position guide along one axis of the exemplar, [length] in 0..255."""
    return (STEPS * np.arange(length) // length).astype(np.int32)


def warped_gradient(places: Float32, length: int) -> Int32:
    """Gradient of an axis of ``length`` pixels, bilinear at continuous ``places``, truncated."""
    steps = gradient(length)
    inside = np.clip(places - np.float32(0.5), 0, length - 1)
    low = np.minimum(inside.astype(np.int32), max(length - 2, 0))
    share = inside - low
    high = np.minimum(low + 1, length - 1)
    # A breath of rounding must not turn a whole step into the one below.
    value = steps[low] + share * (steps[high] - steps[low]) + 1e-4
    return value.astype(np.int32)


def published_table(appearance: Int32, config: FaceBlitConfig, rows: range = range(STEPS)) -> Int32:
    """The table of an exemplar, int32 [256, 256, 256] (y step, x step, appearance): flat indices.

    ``rows`` limits which rows of cells an exhaustive search fills (to measure its speed).
    """
    height, width = appearance.shape
    table = np.empty((STEPS, STEPS, STEPS), np.int32)
    arguments = (gradient(width), gradient(height), appearance, POSITION, APPEARANCE, WINDOW)
    if config.table == "exhaustive":
        search_windows(*arguments, rows.start, rows.stop, table)
    else:
        sweep_windows(*arguments, table)
    return table


def published_mask(image: UInt8, landmarks: Float64) -> Bool:
    """Mask of the face: the jaw's hull, an ellipse, and the forehead by three samples of skin."""
    height, width = image.shape[:2]
    left, right = landmarks[0], landmarks[16]
    span = float(right[0] - left[0])
    mask = np.zeros((height, width), bool)
    bottom, top = int(left[1]), int(left[1] - 0.75 * span)
    first, last = int(left[0]), int(right[0])
    chroma = np.asarray(Image.fromarray(image).convert("YCbCr"), np.int32)[..., 1:]
    for band in range(3):
        # Bands overlap by half; each is judged by the sample in its middle.
        start, end = first + band * span / 4, first + (band + 2) * span / 4
        x, y = int(start + span / 4), int(bottom - span / 4)
        columns, rows = (np.clip(np.array([-5, 0, 5]) + middle, 0, limit - 1)
                         for middle, limit in ((x, width), (y, height)))
        sample = chroma[np.ix_(rows, columns)].mean(axis=(0, 1)).astype(np.int32)
        box = (slice(max(top, 0), max(bottom, 0)),
               slice(max(int(start), 0), max(min(int(end), last), 0)))
        # The published difference saturates at 0: a chroma above the sample's costs nothing.
        below = np.maximum(sample - chroma[box], 0)
        mask[box] |= (below ** 2).sum(axis=-1) < 50
    jaw = landmarks[:17]
    mask |= polygon2mask((height, width), jaw[:, ::-1])
    middle = 0.5 * (left + right)
    y, x = np.mgrid[:height, :width]
    mask |= (((x - middle[0]) / max(span / 2, 1)) ** 2
             + ((y - middle[1]) / max(span / 2.5, 1)) ** 2) <= 1
    return mask


def _head_box(landmarks: Float64, shape: tuple[int, ...]) -> Int64:
    """The published rectangle about the head (left, top, right, bottom), inside the picture."""
    (x0, y0), (x16, y16) = landmarks[0], landmarks[16]
    width = x16 - x0
    top = min(y0, y16) - width / 2
    tall = landmarks[8, 1] - top
    box = np.array([x0 - 0.1 * width, top - 0.2 * tall, x0 + 1.1 * width, top + 1.2 * tall])
    limits = np.array([shape[1], shape[0], shape[1], shape[0]])
    return np.clip(box, 0, limits).astype(np.int64)


class FaceBlit:
    """One exemplar prepared as FaceBlit does."""

    def __init__(self, exemplar: Exemplar, config: FaceBlitConfig | None = None) -> None:
        self.exemplar = exemplar
        self.config = config or FaceBlitConfig()
        start = time.perf_counter()
        self.appearance = stretched(appearance_levels(exemplar.image))
        self.table = published_table(self.appearance, self.config)
        self.seconds = time.perf_counter() - start
        self._colors = pack_colors(exemplar.image.astype(np.float32) / np.float32(255))

    def apply(self, image: UInt8, landmarks: NDArray[np.floating]) -> Painted:
        """Stylise one photo uint8 [H, W, 3] with landmarks [68, 2] in pixels, all known."""
        config = self.config
        start = time.perf_counter()
        photo = np.ascontiguousarray(image[..., :3])
        points = np.asarray(landmarks, np.float64)
        red, green = self._position(photo.shape, points)
        appearance = matched_levels(appearance_levels(photo), self.appearance)
        mask = published_mask(photo, points)
        guided = time.perf_counter()
        seeds = self.table[green, red, appearance]
        face = self._synthesise(red, green, appearance, seeds, _head_box(points, photo.shape),
                                APPEARANCE, THRESHOLD)
        ground = photo.astype(np.float32) / np.float32(255)
        if config.background:
            height, width = self.appearance.shape
            # A cell of the guide spans several pixels; its first one is the seed.
            straight = ((-(-green * height // STEPS)) * width + (-(-red * width // STEPS)))
            ground = self._synthesise(
                red, green, appearance, straight.astype(np.int32),
                np.array([0, 0, photo.shape[1], photo.shape[0]]), 0, GROUND_THRESHOLD)
        soft = ndimage.uniform_filter(mask.astype(np.float32), MASK_BLUR)[..., None]
        reached = np.where(np.isfinite(face), face, ground)
        result = np.clip(soft * reached + (1 - soft) * ground, 0, 1).astype(np.float32)
        end = time.perf_counter()
        gradients = np.stack([red, green, np.zeros_like(red)], axis=-1).astype(np.uint8)
        return Painted(result, {"precalculation_seconds": self.seconds,
                                "guides_seconds": guided - start,
                                "synthesis_seconds": end - guided},
                       {"position": gradients, "appearance": appearance.astype(np.uint8),
                        "style_appearance": self.appearance.astype(np.uint8),
                        "synthesis": np.nan_to_num(face), "mask": soft[..., 0]})

    def _position(self, shape: tuple[int, ...], landmarks: Float64) -> tuple[Int32, Int32]:
        """Position guide of a photo: x and y steps, int32 [H, W] each."""
        style_height, style_width = self.appearance.shape
        ours, theirs = landmarks, self.exemplar.landmarks
        if self.config.background:
            ours = np.concatenate([ours, [[0, shape[0]], [shape[1], shape[0]]]])
            theirs = np.concatenate([theirs, [[0, style_height], [style_width, style_height]]])
        places = position_guide(shape, ours, theirs, grid=10)
        return (warped_gradient(places[..., 0], style_width),
                warped_gradient(places[..., 1], style_height))

    def _synthesise(self, red: Int32, green: Int32, appearance: Int32, seeds: Int32,
                    box: Int64, look: int, threshold: int) -> Float32:
        """Flood fill and voting; NaN where no chunk has come. float32 [H, W, 3]."""
        style_height, style_width = self.appearance.shape
        index = np.empty(red.shape, np.int32)
        flood(red, green, appearance, gradient(style_width), gradient(style_height),
              self.appearance, seeds, box, POSITION, look, threshold, index)
        anchor = pixel_centres(red.shape)
        covered = index != NOWHERE
        height, width = red.shape
        radius = RADIUS
        shift, elected = (shift_planes(height, width, radius) for _ in range(2))
        for plane, place, axis in zip(shift, (index % style_width, index // style_width), (0, 1)):
            plane[radius:radius + height, radius:radius + width] = np.where(
                covered, place.astype(np.float32) + np.float32(0.5) - anchor[..., axis], np.nan)
        reach = np.float32(np.inf)
        if radius > 0:
            elect(anchor, reach, shift, radius, width, elected)
            shift = elected
        out = np.empty((*red.shape, 3), np.float32)
        vote(self._colors, anchor, reach, shift, radius, radius, True, out)
        out[~covered] = np.nan
        return out
