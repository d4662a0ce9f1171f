"""Votes of views on the points of a lattice: which views show the person there.

A view is a row of 16 numbers: the camera-to-world matrix [3, 4], the focal lengths and the
principal point, in pixels of the picture that is looked up.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..simd.decorators import kernel, lean_kernel
from ..simd.threads import shared


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


def vote_lattice(  # type: ignore[no-untyped-def]
        cameras, mattes, shapes, first, spacing, size, tolerance):
    """The share of the person in the votes on each lattice point ``first + spacing (x, y, z)``.

    Parameters
    ----------
    cameras
        float64 [V, 16], a row a view (see above).
    mattes
        float32, the V mattes in [0, 1] one after the other, each in scan order.
    shapes
        int64 [V, 2], height and width of each matte.
    first, spacing, size
        The lattice: float64 [3], a step, and points along an edge.
    tolerance
        A point is given up once the background has more than this share of all V votes.

    Returns
    -------
    share
        float32 [size, size, size] (z, y, x), the mean matte over the views that have the point in
        the picture; 0 where it was given up, 1 where no picture shows it.
    """
    share = np.ones((size, size, size), np.float32)
    starts = np.concatenate([[0], np.cumsum(shapes[:, 0] * shapes[:, 1])])
    _vote(cameras, mattes, shapes, starts, first, spacing, tolerance * len(cameras), share)
    return share


@shared("share")
@lean_kernel
def _vote(since, until, cameras, mattes, shapes, starts, first, spacing, limit, share):
    """Fill what `vote_lattice` gives; each view's matte begins at ``starts``."""
    count, size = len(cameras), len(share)
    for k in range(since, until):
        for j in range(size):
            for i in range(size):
                seen = 0
                against = np.float32(0.0)
                for view in range(count):
                    height, width = shapes[view, 0], shapes[view, 1]
                    column, row, depth = _project(
                        cameras[view], first[0] + spacing * i, first[1] + spacing * j,
                        first[2] + spacing * k)
                    if depth > 1e-9 and 0.0 <= column < width and 0.0 <= row < height:
                        seen += 1
                        against += np.float32(1.0) - mattes[
                            starts[view] + int(row) * width + int(column)]
                        if against > limit:
                            break
                if against > limit:
                    share[k, j, i] = 0.0
                elif seen > 0:
                    share[k, j, i] = np.float32(1.0) - against / np.float32(seen)


@kernel
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
