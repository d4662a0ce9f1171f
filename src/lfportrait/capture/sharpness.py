"""Sharpness of photos relative to others of the scene, and detection of blurred ones.

Blur takes the fine detail and leaves the coarse one, so the measure is the energy of the second
derivative at a fine scale over that at a coarse one: exposure and contrast cancel. A moving camera
blurs in one direction only, so it is taken in four directions, of which the worst counts. What the
scene itself has in fine detail cancels against the photos taken before and after.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..simd.threads import side_by_side

__all__ = ["blurred", "fineness", "relative_sharpness"]

_SIDE = 960
_FINE, _COARSE = 0.8, 2.4
_NEIGHBOURS = 4


def _second_derivatives(grey: NDArray[np.float32], sigma: float) -> list[NDArray[np.float32]]:
    """xx, xy and yy of the picture smoothed by ``sigma`` pixels."""
    reach = int(np.ceil(4 * sigma))
    x = np.arange(-reach, reach + 1) / sigma
    bell = np.exp(-0.5 * x * x)
    bell /= bell.sum()
    smooth, slope, bend = bell, -x * bell, (x * x - 1) * bell
    bend = bend - bend.mean()
    found = []
    for along, across in ((bend, smooth), (slope, slope), (smooth, bend)):
        plane = cv2.sepFilter2D(grey, cv2.CV_32F, along, across, borderType=cv2.BORDER_REPLICATE)
        found.append(np.asarray(plane, np.float32))
    return found


def fineness(image: NDArray[np.uint8], side: int = _SIDE) -> NDArray[np.float64]:
    """Fine over coarse detail along 0, 45, 90 and 135 degrees, float64 [4].

    Parameters
    ----------
    image
        uint8 [H, W], or [H, W, 3 or more] of which the first three channels count.
    side
        A larger picture is reduced to this many pixels on its longer side first.
    """
    grey = image if image.ndim == 2 else cv2.cvtColor(
        np.ascontiguousarray(image[..., :3]), cv2.COLOR_RGB2GRAY)
    factor = side / max(grey.shape)
    if factor < 1:
        grey = cv2.resize(np.ascontiguousarray(grey), None, fx=factor, fy=factor,
                          interpolation=cv2.INTER_AREA)
    energies = []
    for sigma in (_FINE, _COARSE):
        xx, xy, yy = _second_derivatives(grey.astype(np.float32), sigma)
        # The second derivative along (c, s) is c^2 xx + 2 c s xy + s^2 yy.
        energies.append([float(np.mean(np.square(plane))) for plane in (
            xx, 0.5 * (xx + yy) + xy, yy, 0.5 * (xx + yy) - xy)])
    # A flat picture has no detail at all: the small term keeps its ratio finite.
    return (np.array(energies[0]) + 1e-6) / (np.array(energies[1]) + 1e-6)


def relative_sharpness(measures: NDArray[np.float64], groups: Sequence[Any] | None = None,
                       reach: int = _NEIGHBOURS) -> NDArray[np.float64]:
    """Sharpness of each picture relative to its neighbours, float64 [V]; 1 is usual.

    Parameters
    ----------
    measures
        float64 [V, 4], `fineness` of each.
    groups
        What a picture must have in common with those it is compared with (its size); by default all
        are alike.
    reach
        Neighbours on either side.
    """
    groups = [0] * len(measures) if groups is None else groups
    found = np.ones(len(measures))
    for index, own in enumerate(measures):
        before = [i for i in range(index) if groups[i] == groups[index]][-reach:]
        after = [i for i in range(index + 1, len(measures)) if groups[i] == groups[index]][:reach]
        if before or after:
            found[index] = float((own / np.median(measures[before + after], axis=0)).min())
    return found


def blurred(images: Sequence[NDArray[np.uint8]], threshold: float) -> list[int]:
    """Indices of the pictures that are blurred relative to their neighbours, in order.

    Parameters
    ----------
    images
        V pictures in the order in which they were taken, uint8 [H, W, 3 or 4].
    threshold
        Those whose fine detail, in their worst direction, is below this part of their neighbours'
        are blurred; 0 finds none.

    Returns
    -------
    indices
        A quarter of the pictures at most, the worst; none where there are fewer than six, too few
        to compare.
    """
    if threshold <= 0 or len(images) < 6:
        return []
    sharp = relative_sharpness(np.array(side_by_side(fineness, images)),
                               [image.shape[:2] for image in images])
    worst = np.argsort(sharp, kind="stable")[:len(images) // 4]
    return sorted(int(index) for index in worst if sharp[index] < threshold)
