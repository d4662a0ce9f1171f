"""Trilinear interpolation of a sparse lattice's rows at the points of a finer one."""

from __future__ import annotations

import numpy as np

from ...lanes.decorators import lean_kernel
from ...lanes.threads import shared

__all__ = ["refine_rows"]


def refine_rows(links, density, rows, places, low, part):
    """Density and color rows at fine points.

    Parameters
    ----------
    links
        int32 [Z, Y, X], row of each coarse point or -1.
    density, rows
        float32 [N + 1] and [N + 1, width].
    places
        int64 [M, 3] (z, y, x), the fine points.
    low, part
        Coarse cell and place inside it of each fine plane, per axis (z, y, x): int64 and float32
        [3, longest side].

    Returns
    -------
    density, rows
        float32 [M + 1] and [M + 1, width], the last row zero. Color is the mean over the corners
        that exist: empty points have none to mix in.
    """
    fine = np.zeros(len(places) + 1, np.float32)
    fine_rows = np.zeros((len(places) + 1, rows.shape[1]), np.float32)
    _refine(links, density, rows, places, low, part, fine, fine_rows)
    return fine, fine_rows


@shared("places")
@lean_kernel
def _refine(since, until, links, density, rows, places, low, part, fine, fine_rows):
    """Fill what `refine_rows` gives."""
    width, one = rows.shape[1], np.float32(1.0)
    for point in range(since, until):
        z, y, x = places[point, 0], places[point, 1], places[point, 2]
        mass = np.float32(0.0)
        for corner in range(8):
            dz, dy, dx = corner >> 2, (corner >> 1) & 1, corner & 1
            row = links[low[0, z] + dz, low[1, y] + dy, low[2, x] + dx]
            if row < 0:
                continue
            weight = ((part[0, z] if dz else one - part[0, z])
                      * (part[1, y] if dy else one - part[1, y])
                      * (part[2, x] if dx else one - part[2, x]))
            fine[point] += weight * density[row]
            mass += weight
            for i in range(width):
                fine_rows[point, i] += weight * rows[row, i]
        scale = one / max(mass, np.float32(1e-6))
        for i in range(width):
            fine_rows[point, i] *= scale
