"""Views voting on the points of a lattice: which of them show the person there.

A view is a row of 16 numbers: the camera-to-world matrix [3, 4], the focal lengths and the
principal point, in pixels of the picture that is looked up.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

__all__ = ["cover_views", "vote_lattice"]


@njit(cache=True, inline="always")
def _project(camera, x, y, z):  # type: ignore[no-untyped-def]
    """Column, row and depth of a point."""
    dx, dy, dz = x - camera[3], y - camera[7], z - camera[11]
    depth = camera[2] * dx + camera[6] * dy + camera[10] * dz
    if depth <= 1e-9:
        return -1.0, -1.0, depth
    u = (camera[0] * dx + camera[4] * dy + camera[8] * dz) / depth
    v = (camera[1] * dx + camera[5] * dy + camera[9] * dz) / depth
    return u * camera[12] + camera[14], v * camera[13] + camera[15], depth


@njit(cache=True, parallel=True)
def vote_lattice(camera, matte, first, spacing, votes, seen):  # type: ignore[no-untyped-def]
    """Add one view's matte (float32 [H, W]) to ``votes`` and 1 to ``seen``, float32 [Z, Y, X].

    Both at each lattice point ``first + spacing * (x, y, z)`` that the view's picture shows.
    """
    height, width = matte.shape
    for k in prange(votes.shape[0]):
        for j in range(votes.shape[1]):
            for i in range(votes.shape[2]):
                column, row, depth = _project(camera, first[0] + spacing * i,
                                              first[1] + spacing * j, first[2] + spacing * k)
                if depth > 1e-9 and 0.0 <= column < width and 0.0 <= row < height:
                    votes[k, j, i] += matte[int(row), int(column)]
                    seen[k, j, i] += np.float32(1.0)


@njit(cache=True)
def cover_views(camera, points, first, spacing, height, width):  # type: ignore[no-untyped-def]
    """Pixels, bool [height, width], in which one of the lattice's ``points`` lies.

    ``points`` is bool [Z, Y, X].
    """
    covered = np.zeros((height, width), np.bool_)
    for k in range(points.shape[0]):
        for j in range(points.shape[1]):
            for i in range(points.shape[2]):
                if points[k, j, i]:
                    column, row, depth = _project(camera, first[0] + spacing * i,
                                                  first[1] + spacing * j, first[2] + spacing * k)
                    if depth > 1e-9 and 0.0 <= column < width and 0.0 <= row < height:
                        covered[int(row), int(column)] = True
    return covered
