"""Depth maps on a lattice: votes, signed distances, outlines; and pictures looked up on surfaces.

A view is a row of 16 numbers: the camera-to-world matrix [3, 4], the focal lengths and the
principal point in pixels.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...simd.decorators import lean_kernel
from ...simd.threads import shared


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
    x, y, z : float64, coordinates of the lattice's planes in the world.
    camera : float64 [16], pose row by row, focal, principal point of the depth map.
    depth, sure, image : float32 [h, w], distance along the optical axis; bool [h, w], whether it
        was measured or only guessed; float32 [h, w, 3].
    margin, slack : Half thickness of a measured surface in world units, of a guessed one in parts
        of its depth.
    empty, solid, unsure : int16 [Z, Y, X]: views that look through the point, that see a surface
        there, that guess one there.
    color : float32 [Z, Y, X, 3], sum of the colors of those that see a surface.
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


@shared("axis")
@lean_kernel
def fuse_distance(  # type: ignore[no-untyped-def]
        since, until, axis, camera, depth, matte, reach, total, count, person, seen):
    """Add one view's depth to a lattice of signed distances (Curless and Levoy 1996).

    Parameters
    ----------
    axis : float64 [N], coordinates of the points along each of x, y, z.
    camera : float64 [16], the view of the depth map.
    depth, matte : float32 [h, w]: distance along the optical axis, 0 where it is not known; how
        much of the pixel is the person, in [0, 1].
    reach : Distance in world units at which the measure ends: 1 in front, -1 behind the surface.
    total : float32 [N, N, N] (z, y, x), sum of the distances in parts of ``reach``.
    count : int16 [N, N, N], how many views it is of. A point further behind a surface is hidden and
        not counted.
    person : float32 [N, N, N], sum of the matte over the views whose surface is within ``reach``.
    seen : int16 [N, N, N], how many these are.
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
    distance : float32 [N, N, N] (z, y, x), 1 where space is empty.
    clear : uint8 [N, N, N], from a cell (named by its lowest corner) this many cells in every
        direction have the value 1 at all corners, 0 for a cell that has not.
    first, spacing : Coordinate of the first point along each axis, distance of the points.
    camera : float64 [16].
    height, width : Size of the picture.

    Returns
    -------
    least : float32 [height, width], in (-1, 1]; a ray that is deep inside the solid ends there.
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


@shared("inverse")
@lean_kernel
def compose_plate(  # type: ignore[no-untyped-def]
        since, until, inverse, wanted, camera, others, pictures, gains, enough, spread, scratch,
        color, noise, known):
    """Colors of a surface as other views show it, as one view sees it.

    The colors of the views are averaged, each by its weight and by how well it agrees with their
    mean (two steps of reweighting by Geman and McClure's function), so that few that show
    something else do not count. Views are asked in their order until their weights are ``enough``.

    Parameters
    ----------
    inverse : float32 [h, w], one over the surface's distance along the optical axis of the view.
    wanted : uint8 [h, w], zero where nothing is to be filled.
    camera, others : float64 [16] and [K, 16]: pose row by row, focal, principal point in pixels.
    pictures : uint8 [K, H, W, 4], sRGB and the weight of each pixel: how surely it shows the
        surface.
    gains : float32 [K, 3], by which the colors of each picture are multiplied.
    enough : Sum of weights after which no more views are asked.
    spread : Difference of colors, in [0, 1], from which on they count as different.
    scratch : float32 [h, K, 4], overwritten.
    color, noise, known : float32 [h, w, 3], [h, w] and [h, w], filled: mean color in [0, 1], its
        standard deviation over the views (root of the channels' mean variance), and the sum of the
        weights.
    """
    width = inverse.shape[1]
    count, high, wide = pictures.shape[0], pictures.shape[1], pictures.shape[2]
    scale = np.float32(1.0 / 255.0)
    for y in range(since, until):
        samples = scratch[y]
        for x in range(width):
            if wanted[y, x] == 0:
                continue
            along = 1.0 / max(np.float64(inverse[y, x]), 1e-6)
            u = (x + 0.5 - camera[14]) / camera[12] * along
            v = (y + 0.5 - camera[15]) / camera[13] * along
            px = camera[0] * u + camera[1] * v + camera[2] * along + camera[3]
            py = camera[4] * u + camera[5] * v + camera[6] * along + camera[7]
            pz = camera[8] * u + camera[9] * v + camera[10] * along + camera[11]
            used, sum_of_weights = 0, np.float32(0.0)
            for k in range(count):
                if sum_of_weights >= enough:
                    break
                dx, dy, dz = px - others[k, 3], py - others[k, 7], pz - others[k, 11]
                far = others[k, 2] * dx + others[k, 6] * dy + others[k, 10] * dz
                if far <= 1e-6:
                    continue
                column = (others[k, 0] * dx + others[k, 4] * dy + others[k, 8] * dz) / far
                row = (others[k, 1] * dx + others[k, 5] * dy + others[k, 9] * dz) / far
                column = column * others[k, 12] + others[k, 14] - 0.5
                row = row * others[k, 13] + others[k, 15] - 0.5
                if not (0.0 <= column < wide - 1 and 0.0 <= row < high - 1):
                    continue
                left, top = int(column), int(row)
                a, b = np.float32(column - left), np.float32(row - top)
                one = np.float32(1.0)
                for channel in range(4):
                    upper = (pictures[k, top, left, channel] * (one - a)
                             + pictures[k, top, left + 1, channel] * a)
                    lower = (pictures[k, top + 1, left, channel] * (one - a)
                             + pictures[k, top + 1, left + 1, channel] * a)
                    samples[used, channel] = (upper * (one - b) + lower * b) * scale
                if samples[used, 3] > np.float32(0.004):
                    for channel in range(3):
                        samples[used, channel] *= gains[k, channel]
                    sum_of_weights += samples[used, 3]
                    used += 1
            red = green = blue = total = variance = np.float32(0.0)
            for step in range(3):
                r = g = h = mass = squared = np.float32(0.0)
                for k in range(used):
                    weight = samples[k, 3]
                    if step > 0:
                        away = ((samples[k, 0] - red) ** 2 + (samples[k, 1] - green) ** 2
                                + (samples[k, 2] - blue) ** 2)
                        near = spread * spread / (spread * spread + away)
                        weight *= near * near
                        squared += weight * away
                    r += weight * samples[k, 0]
                    g += weight * samples[k, 1]
                    h += weight * samples[k, 2]
                    mass += weight
                if mass > np.float32(0.0):
                    red, green, blue = r / mass, g / mass, h / mass
                    variance = squared / (np.float32(3.0) * mass)
                total = mass
            color[y, x, 0], color[y, x, 1], color[y, x, 2] = red, green, blue
            noise[y, x], known[y, x] = np.sqrt(variance), total


@shared("z")
@lean_kernel
def carve(since, until, x, y, z, camera, covered, asked, seen, against):
    """Count, for each point asked about, the view if it shows it, and if it shows it empty."""
    height, width = covered.shape
    for k in range(since, until):
        for j in range(len(y)):
            for i in range(len(x)):
                if not asked[k, j, i]:
                    continue
                row, column, _ = pixel_of(x[i], y[j], z[k], camera, height, width)
                if row >= 0:
                    seen[k, j, i] += 1
                    if not covered[row, column]:
                        against[k, j, i] += 1
