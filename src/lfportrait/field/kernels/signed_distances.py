"""Solids from depth maps: signed distances fused on a lattice, and their outlines in pictures.

A view is a row of 16 numbers: the camera-to-world matrix [3, 4], the focal lengths and the
principal point in pixels.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...simd.decorators import lean_kernel
from ...simd.threads import shared
from .depth_votes import pixel_of

__all__ = ["fuse_distance", "outline_distance"]


@shared("axis")
@lean_kernel
def fuse_distance(  # type: ignore[no-untyped-def]
        since, until, axis, camera, depth, matte, reach, total, count, person, seen):
    """Add one view's depth to a lattice of signed distances (Curless and Levoy 1996).

    Parameters
    ----------
    axis
        float64 [N], coordinates of the points along each of x, y, z.
    camera
        float64 [16], the view of the depth map.
    depth, matte
        float32 [h, w]: distance along the optical axis, 0 where it is not known; how much of the
        pixel is the person, in [0, 1].
    reach
        Distance in world units at which the measure ends: 1 in front, -1 behind the surface.
    total
        float32 [N, N, N] (z, y, x), sum of the distances in parts of ``reach``.
    count
        int16 [N, N, N], how many views it is of. A point further behind a surface is hidden and
        not counted.
    person
        float32 [N, N, N], sum of the matte over the views whose surface is within ``reach``.
    seen
        int16 [N, N, N], how many these are.
    """
    height, width = depth.shape
    size = len(axis)
    for k in range(since, until):
        for j in range(size):
            for i in range(size):
                row, column, along = pixel_of(axis[i], axis[j], axis[k], camera, height, width)
                if row < 0:
                    continue
                there = depth[row, column]
                if there <= 0.0:
                    continue
                ahead = (there - along) / reach
                if ahead < -1.0:
                    continue
                total[k, j, i] += min(ahead, 1.0)
                count[k, j, i] += 1
                if ahead <= 1.0:
                    person[k, j, i] += matte[row, column]
                    seen[k, j, i] += 1


@njit(cache=True, inline="always")
def _between(distance, x, y, z):  # type: ignore[no-untyped-def]
    """The lattice's value at a place given in points, trilinear."""
    i, j, k = int(x), int(y), int(z)
    fx, fy, fz = x - i, y - j, z - k
    low = ((1.0 - fy) * ((1.0 - fx) * distance[k, j, i] + fx * distance[k, j, i + 1])
           + fy * ((1.0 - fx) * distance[k, j + 1, i] + fx * distance[k, j + 1, i + 1]))
    high = ((1.0 - fy) * ((1.0 - fx) * distance[k + 1, j, i] + fx * distance[k + 1, j, i + 1])
            + fy * ((1.0 - fx) * distance[k + 1, j + 1, i] + fx * distance[k + 1, j + 1, i + 1]))
    return (1.0 - fz) * low + fz * high


def outline_distance(  # type: ignore[no-untyped-def]
        distance, clear, first, spacing, camera, height, width):
    """The least signed distance along the ray of each pixel: below zero where the solid is.

    Parameters
    ----------
    distance
        float32 [N, N, N] (z, y, x), 1 where space is empty.
    clear
        uint8 [N, N, N], from a cell (named by its lowest corner) this many cells in every
        direction have the value 1 at all corners, 0 for a cell that has not.
    first, spacing
        Coordinate of the first point along each axis, distance of the points.
    camera
        float64 [16].
    height, width
        Size of the picture.

    Returns
    -------
    least
        float32 [height, width], in (-1, 1]; a ray that is deep inside the solid ends there.
    """
    least = np.ones((height, width), np.float32)
    _outline_rows(distance, clear, first, spacing, camera, least)
    return least


@shared("least")
@lean_kernel
def _outline_rows(since, until, distance, clear, first, spacing, camera, least):
    """Fill what `outline_distance` gives."""
    top = distance.shape[0] - 1.0
    for row in range(since, until):
        for column in range(least.shape[1]):
            x = (column + 0.5 - camera[14]) / camera[12]
            y = (row + 0.5 - camera[15]) / camera[13]
            ax = camera[0] * x + camera[1] * y + camera[2]
            ay = camera[4] * x + camera[5] * y + camera[6]
            az = camera[8] * x + camera[9] * y + camera[10]
            norm = np.sqrt(ax * ax + ay * ay + az * az)
            # In points, a step of one is a step of one point's distance.
            ax, ay, az = ax / norm, ay / norm, az / norm
            ox, oy = (camera[3] - first) / spacing, (camera[7] - first) / spacing
            oz = (camera[11] - first) / spacing
            start, end = 0.0, 1e9
            for origin, slope in ((ox, ax), (oy, ay), (oz, az)):
                if abs(slope) < 1e-9:
                    slope = 1e-9
                one, two = -origin / slope, (top - origin) / slope
                start, end = max(start, min(one, two)), min(end, max(one, two))
            t = start + 1e-3
            best = 1.0
            while t < end - 1e-3:
                px, py, pz = ox + t * ax, oy + t * ay, oz + t * az
                free = clear[int(pz), int(py), int(px)]
                if free > 0:
                    t += max(0.5, free - 1.0)
                    continue
                best = min(best, _between(distance, px, py, pz))
                if best < -0.8:
                    break
                t += 0.5
            least[row, column] = best
