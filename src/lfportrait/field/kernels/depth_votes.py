"""Votes of depth maps on the points of a lattice: empty, surface, or unknown."""

from __future__ import annotations

import numpy as np
from numba import njit

from ...simd.decorators import lean_kernel
from ...simd.threads import shared

__all__ = ["fuse_depth", "pixel_of"]


@njit(cache=True, inline="always")
def pixel_of(x, y, z, camera, height, width):
    """Where a camera has a point: row and column of the pixel, and distance along the optical axis.

    ``camera`` is float64 [16], pose row by row, focal, principal point. The row is -1 where the
    point lies outside the picture of ``height`` x ``width`` pixels or behind the camera.
    """
    dx, dy, dz = x - camera[3], y - camera[7], z - camera[11]
    along = camera[2] * dx + camera[6] * dy + camera[10] * dz
    if along <= 1e-6:
        return -1, -1, along
    u = (camera[0] * dx + camera[4] * dy + camera[8] * dz) / along
    v = (camera[1] * dx + camera[5] * dy + camera[9] * dz) / along
    column = int(np.floor(u * camera[12] + camera[14]))
    row = int(np.floor(v * camera[13] + camera[15]))
    if not (0 <= column < width and 0 <= row < height):
        return -1, -1, along
    return row, column, along


@shared("z")
@lean_kernel
def fuse_depth(since, until, x, y, z, camera, depth, sure, image, margin, slack, empty, solid,
               unsure, color):
    """Add one view's votes.

    Parameters
    ----------
    x, y, z
        float64, coordinates of the lattice's planes in the world.
    camera
        float64 [16], pose row by row, focal, principal point of the depth map.
    depth, sure, image
        float32 [h, w], distance along the optical axis; bool [h, w], whether it was measured or
        only guessed; float32 [h, w, 3].
    margin, slack
        Half thickness of a measured surface in world units, of a guessed one in parts of its depth.
    empty, solid, unsure
        int16 [Z, Y, X]: views that look through the point, that see a surface there, that guess one
        there.
    color
        float32 [Z, Y, X, 3], sum of the colors of those that see a surface.
    """
    height, width = depth.shape
    for k in range(since, until):
        for j in range(len(y)):
            for i in range(len(x)):
                row, column, along = pixel_of(x[i], y[j], z[k], camera, height, width)
                if row < 0:
                    continue
                there = depth[row, column]
                thick = margin if sure[row, column] else max(margin, slack * there)
                if along < there - thick:
                    empty[k, j, i] += 1
                elif along < there + thick:
                    if sure[row, column]:
                        solid[k, j, i] += 1
                        for channel in range(3):
                            color[k, j, i, channel] += image[row, column, channel]
                    else:
                        unsure[k, j, i] += 1
