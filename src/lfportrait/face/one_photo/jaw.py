"""The edge of a jaw before its neck, where a photo shows it.

Landmarks of a jaw lie beside its edge by a few hundredths of the eyes' distance, and no matte shows
it before a neck. What is left between the two would be painted on the throat as a second chin. So
the edge is looked for across the jaw, where the photo has the strongest one along all of it: the
best path through a band around the landmarks, by dynamic programming.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ...arrays import Float32, Float64
from ..head_fit import across_jaw

FIRST, LAST = 5, 12
"""Landmarks from the first to the one before the last have an edge; it is looked for from one
before the first to the last."""
BETWEEN = 6  # Places that are looked at from one landmark to the next.
WIDE, STEPS = 0.07, 240
"""How far from the landmarks, over the distance of the eyes' outer corners, an edge may be; and
steps to that distance."""
FINE, ACROSS = 0.008, 0.033
"""Widths of the blur before edges are looked for, and of an edge, over the same distance."""
FAINT, CLEAR = 4.0, 6.0
"""How strong an edge is at least (CIE 1976 L*a*b*); and one that counts half as much as the band's
whole width: no edge counts more than that, so that a collar's, which is stronger, is not taken."""
BEND, STEP = 0.25, 3
"""What a step more or less from place to place costs; and how many there may be."""


def jaw_edge(image: NDArray[np.uint8], landmarks: Float64) -> Float64:
    """Where a photo shows the edge of a chin, beside its landmarks.

    Parameters
    ----------
    image : uint8 [H, W, 3].
    landmarks : float64 [68, 2] in pixels.

    Returns
    -------
    places : float64 [17, 2] in pixels, for each landmark of the jaw; NaN where there is no edge.
    """
    eyes = float(np.linalg.norm(landmarks[45] - landmarks[36]))
    along = np.linspace(FIRST - 1, LAST, (LAST - FIRST + 1) * BETWEEN + 1)
    places, across = (CubicSpline(np.arange(17), one)(along)
                      for one in (landmarks[:17], across_jaw(landmarks)))
    half, wide = round(0.5 * ACROSS * STEPS), int(WIDE * STEPS)
    offsets = np.arange(-wide - half, wide + half + 1) * eyes / STEPS
    seen = _profiles(image, places[:, None] + offsets[None, :, None] * across[:, None],
                     FINE * eyes)
    change = seen[:, 2 * half:] - seen[:, :-2 * half]
    # Below a chin lies its shade.
    edges = np.maximum(-change[..., 0], 0) + 0.5 * np.hypot(change[..., 1], change[..., 2])
    away = np.arange(-wide, wide + 1)
    path = cheapest_path((away / wide) ** 2 - edges / (edges + CLEAR), BEND, STEP)
    chosen = np.arange(BETWEEN, (LAST - FIRST) * BETWEEN + 1, BETWEEN)
    found = places[chosen] + (away[path[chosen]] * eyes / STEPS)[:, None] * across[chosen]
    found[edges[chosen, path[chosen]] < FAINT] = np.nan
    out = np.full((17, 2), np.nan)
    out[FIRST:LAST] = found
    return out


def _profiles(image: NDArray[np.uint8], at: Float64, sigma: float) -> Float32:
    """Colors in CIE 1976 L*a*b* at places [N, M, 2] of a photo that is blurred, [N, M, 3]."""
    size = np.array(image.shape[1::-1])
    low = np.clip(np.floor(at.min(axis=(0, 1)) - 4 * sigma - 2), 0, size - 1).astype(int)
    high = np.clip(np.ceil(at.max(axis=(0, 1)) + 4 * sigma + 2), low + 1, size).astype(int)
    part = image[low[1]:high[1], low[0]:high[0]].astype(np.float32) / np.float32(255)
    lab = cv2.GaussianBlur(cv2.cvtColor(part, cv2.COLOR_RGB2LAB), (0, 0), max(sigma, 0.3))
    column, row = np.moveaxis(at - low - 0.5, 2, 0).astype(np.float32)
    return np.asarray(cv2.remap(lab, column, row, cv2.INTER_LINEAR,
                                borderMode=cv2.BORDER_REPLICATE), np.float32)


def cheapest_path(cost: Float64, bend: float, step: int) -> NDArray[np.int64]:
    """The path through a band that costs least, a column for each row, int64 [N].

    Parameters
    ----------
    cost : float64 [N, M].
    bend : What it costs to go to a column ``k`` beside, over ``k`` squared.
    step : How many columns a row may differ from the one before.
    """
    shifts = np.arange(-step, step + 1)
    total, before = cost[0], []
    for row in cost[1:]:
        padded = np.pad(total, step, constant_values=np.inf)
        ways = np.stack([padded[step + k:step + k + len(total)] + bend * k * k for k in shifts])
        before.append(ways.argmin(axis=0))
        total = ways.min(axis=0) + row
    path = [int(total.argmin())]
    for choice in reversed(before):
        path.append(path[-1] + int(shifts[choice[path[-1]]]))
    return np.array(path[::-1], np.int64)
