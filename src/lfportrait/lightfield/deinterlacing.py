"""Deinterlacing of coded pictures: a view's sub-pixels, and full pictures of views.

A view owns but few sub-pixels of each row, one in V_n at most. The rest of its picture is filled in
from its own sub-pixels nearby, coarse to fine: sums over blocks of 2, 4, 8, ... pixels stand in
wherever a block of the next finer size holds nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from .coded import check_size
from .display import Display
from .kernels.panel import gather_views, lens_of

__all__ = ["deinterlace", "each_view"]

_MEMORY = 400_000_000
"""Bytes that the sums of one pass may take."""


def deinterlace(image: NDArray[np.uint8], display: Display, view: int,
                ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """The sub-pixels of a coded picture that one view owns.

    Parameters
    ----------
    image
        uint8 [H, W, 3], coded for ``display``.
    display
        The panel.
    view
        0 to V_n - 1.

    Returns
    -------
    picture, owned
        uint8 [H, W, 3], zero where the view owns nothing, and bool [H, W, 3].
    """
    check_size(image, display)
    if not 0 <= view < display.views:
        raise UserError(f"the display has views 0 to {display.views - 1}, not {view}")
    rows, columns = np.ogrid[:display.height, :display.width]
    owned = np.zeros(image.shape, bool)
    for place in range(3):
        index = display.view_of(rows, columns, place).astype(np.int64)
        owned[..., display.channel(place)] = index == view
    return np.where(owned, image, 0).astype(np.uint8), owned


def _half(plane: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sums over blocks of 2 x 2; [h, w, c] -> [ceil(h / 2), ceil(w / 2), c]."""
    padded = np.pad(plane, ((0, plane.shape[0] % 2), (0, plane.shape[1] % 2), (0, 0)))
    summed: NDArray[np.float32] = (padded[::2, ::2] + padded[1::2, ::2] + padded[::2, 1::2]
                                   + padded[1::2, 1::2])
    return summed


def _double(plane: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    """Twice the size, interpolated linearly between the middles of the pixels."""
    for axis, size in ((0, height), (1, width)):
        before = np.concatenate([plane.take([0], axis), plane], axis)
        after = np.concatenate([plane, plane.take([-1], axis)], axis)
        first = 0.25 * before.take(range(plane.shape[axis]), axis) + 0.75 * plane
        second = 0.75 * plane + 0.25 * after.take(range(1, plane.shape[axis] + 1), axis)
        both = np.stack([first, second], axis + 1)
        shape = list(plane.shape)
        shape[axis] *= 2
        plane = both.reshape(shape).take(range(size), axis)
    return plane


def _filled(value: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """The weighted mean where there is weight, else what the coarser picture says."""
    known = weight > 0
    mean = np.where(known, value / np.where(known, weight, 1), 0).astype(np.float32)
    if known.all() or max(value.shape[:2]) == 1:
        return mean
    sure = known.astype(np.float32)
    coarse = _filled(_half(mean * sure), _half(sure))
    return np.where(known, mean, _double(coarse, *value.shape[:2]))


def each_view(image: NDArray[np.uint8], display: Display, *, count: int = 0, width: int = 0,
              height: int = 0) -> Iterator[NDArray[np.uint8]]:
    """Whole pictures of the views of a coded picture, the leftmost first.

    Sub-pixels that a view owns come through exactly where its picture has the panel's size, and are
    averaged where it is smaller; the rest is filled in.

    Parameters
    ----------
    image
        uint8 [H, W, 3], coded for ``display``.
    display
        The panel.
    count
        Number of views; the panel's by default. Others are spread over the same cone.
    width, height
        Size of the pictures; the panel's by default.

    Yields
    ------
    view
        uint8 [height, width, 3].
    """
    check_size(image, display)
    count, width, height = count or display.views, width or display.width, height or display.height
    if not 1 <= count <= 4096 or width < 1 or height < 1:
        raise UserError(f"{count} views of {width} x {height} pixels can't be made")
    # Pictures finer than the panel gain nothing but holes.
    inner_width, inner_height = min(width, display.width), min(height, display.height)
    order = np.array([display.channel(place) for place in range(3)])
    at_once = max(1, min(count, _MEMORY // (24 * inner_width * inner_height)))
    image = np.ascontiguousarray(image)
    for first in range(0, count, at_once):
        shape = (min(at_once, count - first), inner_height, inner_width, 3)
        value, weight = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        gather_views(image, display.steps(), display.places(), order, lens_of(display), count,
                     first, value, weight)
        for index in range(shape[0]):
            picture = np.clip(_filled(value[index], weight[index]) + 0.5, 0, 255).astype(np.uint8)
            if (inner_width, inner_height) != (width, height):
                from PIL import Image

                picture = np.asarray(Image.fromarray(picture).resize(
                    (width, height), Image.Resampling.BICUBIC))
            yield picture
