"""Motion between video frames: coarse optical flow, forward and backward.

The flow is OpenCV's DIS on a picture of half the size: chunks and masks that are carried along want
a smooth flow of the whole, and it costs a fifth. Where the two directions disagree it can't be
trusted; where they do nearly everywhere, the scene was cut.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..kernels.video import carry, trust

__all__ = ["Flow", "Motion", "block_side"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

DISAGREE = 1.5
"""Largest difference of the flow there and back in pixels."""
LARGE = 200
"""Pictures whose shorter side has at least so many pixels are reduced to half of it."""
CUT = 0.3
"""Share of trusted places below which two frames have nothing to do with each other."""


@dataclass(frozen=True)
class Motion:
    """Motion from the frame before to this one.

    Attributes
    ----------
    back
        float32 [h, w, 2], place in the frame before minus place here, in pixels, at the middles of
        blocks.
    there
        The same from the frame before, to this one.
    trusted
        bool [h, w].
    factor
        Side of a block in pixels.
    """

    back: Float32
    there: Float32
    trusted: NDArray[np.bool_]
    factor: int

    def carry(self, field: Float32) -> Float32:
        """A field [h, w, C] on the blocks of the frame before as it lies in this one."""
        field = np.ascontiguousarray(field)
        out = np.empty_like(field)
        carry(field, self.back / np.float32(self.factor), out)
        return out

    def onward(self, points: Float64) -> Float64:
        """Where points [N, 2] of the frame before are now: their median, in the blocks around."""
        height, width = self.there.shape[:2]
        columns, rows = (points / self.factor).astype(np.int64).T
        steps = [self.there[np.clip(rows + v, 0, height - 1), np.clip(columns + u, 0, width - 1)]
                 for v in (-1, 0, 1) for u in (-1, 0, 1)]
        return np.asarray(points + np.median(steps, axis=0), np.float64)


def block_side(shape: tuple[int, ...]) -> int:
    """Side in pixels of the blocks on which the flow of pictures (H, W, ...) is known."""
    return 2 if min(shape[:2]) >= LARGE else 1


class Flow:
    """The flow through a video, or nothing where there is no OpenCV."""

    def __init__(self) -> None:
        self._library = _library()
        self._network: Any = None
        if self._library is not None:
            self._network = self._library.DISOpticalFlow_create(
                self._library.DISOPTICAL_FLOW_PRESET_FAST)
        self._before: NDArray[np.uint8] | None = None

    def _luma(self, frame: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
        """The frame in grey, means of blocks of ``factor`` pixels."""
        size = (-(-frame.shape[1] // factor), -(-frame.shape[0] // factor))
        luma = self._library.cvtColor(frame, self._library.COLOR_RGB2GRAY)
        return np.asarray(self._library.resize(luma, size,
                                               interpolation=self._library.INTER_AREA))

    def next(self, frame: NDArray[np.uint8]) -> Motion | None:
        """Motion to the next frame; None for the first one and after a cut."""
        if self._network is None:
            return None
        factor = block_side(frame.shape)
        luma = self._luma(frame, factor)
        before, self._before = self._before, luma
        if before is None or before.shape != luma.shape:
            return None
        back, there = (self._network.calc(one, two, None)
                       for one, two in ((luma, before), (before, luma)))
        trusted = np.empty(luma.shape, np.bool_)
        trust(back, there, np.float32(DISAGREE / factor), trusted)
        if trusted.mean() < CUT or _unlike(luma, before, back):
            return None
        scale = np.float32(factor)
        return Motion(back * scale, there * scale, trusted, factor)


def _unlike(luma: NDArray[np.uint8], before: NDArray[np.uint8], back: Float32) -> bool:
    """Whether the frame before, carried along, explains less than half of what is seen.

    By every fourth sample of every fourth row.
    """
    height, width = luma.shape
    y, x = np.mgrid[1:height:4, 1:width:4]
    v = np.clip(y + back[1::4, 1::4, 1], 0, height - 1)
    u = np.clip(x + back[1::4, 1::4, 0], 0, width - 1)
    j, i = (np.minimum(at.astype(np.int64), size - 2) for at, size in ((v, height), (u, width)))
    fy, fx = v - j, u - i
    carried = ((before[j, i] * (1 - fx) + before[j, i + 1] * fx) * (1 - fy)
               + (before[j + 1, i] * (1 - fx) + before[j + 1, i + 1] * fx) * fy)
    here = luma[1::4, 1::4].astype(np.float32)
    left, all_of_it = np.abs(here - carried).mean(), np.abs(here - here.mean()).mean()
    return bool(left > 0.5 * all_of_it and left > 2)


def _library() -> Any:
    """OpenCV, which has the flow, or None."""
    try:
        import cv2
    except ImportError:
        return None
    return cv2
