"""Descent as in svox2, on which ARF and Ref-NPR are built: RMSProp, and smooth colors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lfportrait.field import C0, VoxelField
from lfportrait.stylize.fit import ColorModel, StyleView

from .kernels.rmsprop import rmsprop_step

__all__ = ["ColorDescent", "total_variation_slope"]

Float32 = NDArray[np.float32]


class ColorDescent:
    """Steps of a field's colors down the slopes of pictures.

    Parameters
    ----------
    model
        The colors; changed in place.
    field
        Its lattice.
    rate
        Step of RMSProp in units of the coefficients of degree 0.
    smoothness
        Weight of the total variation of the colors.
    share
        Share of the rows that a step smooths.
    random
        Chooses them.
    """

    def __init__(self, model: ColorModel, field: VoxelField, rate: float, smoothness: float,
                 share: float, random: np.random.Generator) -> None:
        self.model, self.rate = model, np.float32(rate * C0)
        self.smoothness, self.share, self.random = smoothness, share, random
        self._following = following_rows(field.links, len(field.density))
        self._scale = np.array(field.links.shape[::-1]) / 256.0
        self._gradient = np.zeros((3, len(model.colors)), np.float32)
        self._square = np.zeros_like(model.colors)

    def step(self, slopes: list[tuple[StyleView, Float32]]) -> None:
        """One step down the slopes [h, w, 3] of the losses of some views' pictures."""
        for view, slope in slopes:
            self.model.pulled_back(view, np.ascontiguousarray(slope), self._gradient)
        if self.smoothness > 0:
            rows = np.unique(self.random.integers(
                0, len(self.model.colors), max(1, int(self.share * len(self.model.colors)))))
            total_variation_slope(self.model.colors, self._following, self._scale, rows,
                                  self.smoothness, self._gradient)
        rmsprop_step(self.model.colors, self._gradient, self._square, self.rate)


def following_rows(links: NDArray[np.int32], count: int) -> NDArray[np.int32]:
    """Row of the next lattice point along x, y and z, int32 [N, 3]; a row itself where none is."""
    following = np.repeat(np.arange(count, dtype=np.int32)[:, None], 3, axis=1)
    for axis in range(3):
        here = np.take(links, range(links.shape[axis] - 1), axis=axis)
        there = np.take(links, range(1, links.shape[axis]), axis=axis)
        both = (here >= 0) & (there >= 0)
        following[here[both], 2 - axis] = there[both]
    return following


def total_variation_slope(colors: Float32, following: NDArray[np.int32],
                          scale: NDArray[np.float64], rows: NDArray[np.int64], weight: float,
                          gradient: Float32) -> None:
    """Add the slope of the total variation of some rows to a gradient, as svox2 does.

    The value is the mean over the rows of sqrt(dx^2 + dy^2 + dz^2) of each channel, in
    coefficients; its slope counts lattice points as 256 along an axis.

    Parameters
    ----------
    colors
        float32 [N, 3].
    following
        int32 [N, 3] (`following_rows`).
    scale
        Lattice points along x, y and z over 256.
    rows
        Rows to smooth.
    weight
        Weight of the value.
    gradient
        float32 [3, N]; added to.
    """
    ahead = following[rows]
    change = (colors[ahead] - colors[rows][:, None]) / C0  # [M, axis, channel]
    norm = np.sqrt(1e-9 + (change ** 2).sum(1, keepdims=True))
    slope = (weight / len(rows) / C0) * change * scale[None, :, None] / norm
    for channel in range(3):
        for axis in range(3):
            np.add.at(gradient[channel], ahead[:, axis], slope[:, axis, channel])
        np.add.at(gradient[channel], rows, -slope[:, :, channel].sum(1))
