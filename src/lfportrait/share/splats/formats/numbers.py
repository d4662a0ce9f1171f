"""Numbers as files of splats hold them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["logit", "smallest_three", "to_bytes"]

Float = NDArray[np.float32]


def logit(opacity: Float) -> Float:
    """The logit of opacities [N]; finite, as 0 and 1 are moved inwards a little."""
    value = np.clip(opacity.astype(np.float64), 1e-4, 1 - 1e-4)
    return np.log(value / (1 - value)).astype(np.float32)


def to_bytes(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    """The nearest whole numbers from 0 to 255."""
    return np.asarray(np.clip(np.rint(values), 0, 255), np.uint8)


def smallest_three(turns: Float) -> tuple[NDArray[np.int64], Float]:
    """Quaternions without their largest component, which is made positive and follows from these.

    Parameters
    ----------
    turns
        float32 [N, 4].

    Returns
    -------
    largest
        int64 [N], which component that is.
    others
        float32 [N, 3], in order, within 1 / sqrt(2) of 0.
    """
    largest = np.abs(turns).argmax(axis=1)
    sign = np.sign(turns[np.arange(len(turns)), largest])
    places = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[largest]
    return largest, np.take_along_axis(turns, places, axis=1) * sign[:, None]
