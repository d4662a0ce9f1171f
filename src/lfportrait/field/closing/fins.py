"""Thin sheets that stand out of a mouth.

A camera that passes a face at one height looks along whatever lies level: a sheet of lip that
reaches towards the cameras looks as the lips do, from all of them. From aside it is a beak. So what
is thin from below to above and stands out of the mouth and the chin goes; photos have their word on
the lips after that. Only there: brows, locks and the rims of spectacles are as thin.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float64
from ..grid import VoxelField
from ..trimming import OPAQUE

NOSE, CHIN, CORNERS, MOUTH = 33, 8, [48, 54], slice(48, 68)
"""Landmarks."""
WIDE, DEEP = 0.7, 0.7
"""The part that is looked at reaches so far aside, over the mouth's width, and so far behind the
lips, over the way from nose to chin."""
THIN = 0.09
"""What is lower than this, over the way from nose to chin, is a sheet: lips are thicker."""
AROUND = (0.25, 0.15)
"""Height and width, over that way, of the surroundings that say where lips and chin lie."""
OUT, ROOT = 1.5, 1.0
"""Voxels in front of them from which on a sheet goes, and with it what is next to it."""
_PLACES = 40
"""Places of a mouth along its width and its height."""
EMPTY = -1.0
"""Optical depth of a voxel that is emptied."""


def without_fins(field: VoxelField, landmarks: NDArray[np.floating]) -> VoxelField:
    """A field without thin sheets that stand out of its mouth and chin.

    Parameters
    ----------
    field : Of a head in the portrait frame, without a texture.
    landmarks : [68, 3], iBUG order, of its face.

    Returns
    -------
    field : The same lattice points; those of the sheets are empty.
    """
    ends = landmarks[[NOSE, CHIN, *CORNERS]]
    if not np.isfinite(ends).all():
        return field
    mouth = np.nanmean(landmarks[MOUTH], axis=0)
    tall = float(ends[0, 1] - ends[1, 1])
    aside = WIDE * float(np.linalg.norm(ends[3] - ends[2]))
    low = np.array([mouth[0] - aside, ends[1, 1], mouth[2] - DEEP * tall])
    high = np.array([mouth[0] + aside, ends[0, 1], np.inf])
    shape = field.links.shape[::-1]
    first, last = (np.rint(np.clip((end - field.bounds[0]) / field.spacing - 0.5, 0, shape)
                           ).astype(int) for end in (low, high))
    if (last - first < 3).any():
        return field
    unit = tall / field.spacing
    lowest = round(THIN * float(unit[1]))
    if lowest < 2:  # on so coarse a lattice lips would be sheets
        return field
    # What goes on above or below is as thick as it is there.
    above, below = first[1] - max(first[1] - lowest, 0), min(last[1] + lowest, shape[1]) - last[1]
    links = field.links[first[2]:last[2], first[1] - above:last[1] + below, first[0]:last[0]]
    solid = np.append(field.density > OPAQUE, False)[links]
    thick = ndimage.binary_opening(solid, np.ones((1, lowest, 1)))
    inner = np.s_[:, above:links.shape[1] - below]
    rows = links[inner][_fins(solid[inner], thick[inner], unit)]
    rows = rows[rows >= 0]
    if not len(rows):
        return field
    density = field.density.copy()
    density[rows] = np.minimum(density[rows], np.float32(EMPTY / field.spacing.mean()))
    return replace(field, density=density)


def mouth_of(landmarks: NDArray[np.floating]) -> Float64:
    """Places [N, 3] all over the mouth, of which sheets may have gone; none without landmarks."""
    lips = np.asarray(landmarks, np.float64)[MOUTH]
    lips = lips[np.isfinite(lips).all(axis=1)]
    if not len(lips):
        return lips
    low, high = lips.min(axis=0), lips.max(axis=0)
    across, up = np.meshgrid(np.linspace(low[0], high[0], _PLACES),
                             np.linspace(low[1], high[1], _PLACES))
    depth = np.full(across.size, lips[:, 2].mean())
    return np.stack([across.ravel(), up.ravel(), depth], axis=1)


def _fins(solid: Bool, thick: Bool, unit: NDArray[np.floating]) -> Bool:
    """Which points are to be emptied, bool [z, y, x]; ``unit`` [3] in points (x, y, z)."""
    depth = len(solid)
    # Where nothing is thick nothing stands out.
    front = np.where(thick.any(axis=0), depth - 1 - np.argmax(thick[::-1], axis=0), depth)
    around = [max(3, round(part * size)) for part, size in zip(AROUND, unit[1::-1])]
    front = ndimage.median_filter(front, around, mode="nearest")
    before = np.arange(depth)[:, None, None] - front
    fins = solid & ~thick & (before > OUT)
    return np.asarray(ndimage.binary_dilation(fins, np.ones((3, 3, 3))) & (before > ROOT))
