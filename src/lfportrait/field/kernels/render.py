"""Rendering a pinhole view, the view as a sparse linear map of colors, and its camera's equations.

Packets of 4x4 pixels are cast through bricks. With the density frozen and color independent of
direction, a pixel is a weighted sum of the colors at lattice points (Shen et al. 2023, Eq. 1 with
trilinear interpolation): `pixel_weights` walks each ray once and adds up every lattice row's weight
in a small hash table. `pose_equations` are the normal equations of the motion of the camera that
lays a rendering on a photo.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ...simd.decorators import identified, kernel
from ...simd.threads import share_out, shared, with_kernel
from ...simd.vectors import LANES
from .march import enter_box, make_basis, make_march, make_rgb_shade


@functools.cache
def render_kernel(width: int) -> Callable[..., Any]:
    """The kernel for color rows of 16 or 32; of 0: it leaves colors alone, and needs no rows.

    Returns
    -------
    render : ``render(table, links, density, rows, lattice, count, camera, size, step, threshold,
        stop, color, alpha, depth)`` with ``lattice`` float64 [9] (points along x, y, z; scale
        and offset of the lattice per world unit), ``camera`` float64 [16] (pose row by row,
        focal x, y, principal point x, y), ``size`` (width, height); it fills ``color`` float32
        [H W 3] without background, ``alpha`` [H W] and ``depth`` [H W] (along the optical
        axis).
    """
    march = make_march(LANES, make_rgb_shade(width), width > 0)
    fill_basis = make_basis(width)
    load, store, floats = LANES.load, LANES.store, LANES.floats

    @identified("render", width)
    @kernel
    def render_lines(since, until, table, links, density, rows, lattice, count, camera, size, step,
                     threshold, stop, color, alpha, depth):
        columns = (size[0] + 3) // 4
        nx, ny, nz = np.int32(lattice[0]), np.int32(lattice[1]), np.int32(lattice[2])
        basis, scratch = np.zeros(16 * 64, np.float32), np.zeros(16, np.float32)
        ray = np.zeros((12, 16), np.float32)
        flat = ray.reshape(12 * 16)
        for line in range(since, until):
            for column in range(columns):
                for i in range(16):
                    x = min(4 * column + (i & 3), size[0] - 1)
                    y = min(4 * line + (i >> 2), size[1] - 1)
                    cx = (x + 0.5 - camera[14]) / camera[12]
                    cy = (y + 0.5 - camera[15]) / camera[13]
                    scale = 1.0 / np.sqrt(cx * cx + cy * cy + 1.0)
                    wx = (camera[0] * cx + camera[1] * cy + camera[2]) * scale
                    wy = (camera[4] * cx + camera[5] * cy + camera[6]) * scale
                    wz = (camera[8] * cx + camera[9] * cy + camera[10]) * scale
                    if width > 0:
                        fill_basis(np.float32(wx), np.float32(wy), np.float32(wz), count, basis,
                                   64 * i, scratch)
                    gx, gy, gz = wx * lattice[3], wy * lattice[4], wz * lattice[5]
                    norm = np.sqrt(gx * gx + gy * gy + gz * gz)
                    ox = np.float32(camera[3] * lattice[3] + lattice[6])
                    oy = np.float32(camera[7] * lattice[4] + lattice[7])
                    oz = np.float32(camera[11] * lattice[5] + lattice[8])
                    dx, dy, dz = np.float32(gx / norm), np.float32(gy / norm), np.float32(gz / norm)
                    start, end = enter_box(ox, oy, oz, dx, dy, dz, nx, ny, nz)
                    ray[0, i], ray[1, i], ray[2, i] = ox, oy, oz
                    ray[3, i], ray[4, i], ray[5, i] = dx, dy, dz
                    ray[6, i], ray[7, i] = start, end
                    ray[8, i] = np.float32(step / norm)
                    # Lattice distance along the ray to distance along the optical axis.
                    ray[9, i] = np.float32(scale / norm)
                red, green, blue, through, where_half = march(
                    table, links, density, rows, nx, ny, nz, load(flat, 0), load(flat, 16),
                    load(flat, 32), load(flat, 48), load(flat, 64), load(flat, 80), load(flat, 96),
                    load(flat, 112), np.float32(step), load(flat, 128), np.float32(threshold),
                    np.float32(stop), basis, floats(np.float32(0.0)))
                where_half = where_half * load(flat, 144)
                store(flat, 0, red)
                store(flat, 16, green)
                store(flat, 32, blue)
                store(flat, 48, through)
                store(flat, 64, where_half)
                for i in range(16):
                    x, y = 4 * column + (i & 3), 4 * line + (i >> 2)
                    if x < size[0] and y < size[1]:
                        pixel = y * size[0] + x
                        if width > 0:
                            color[3 * pixel] = ray[0, i]
                            color[3 * pixel + 1] = ray[1, i]
                            color[3 * pixel + 2] = ray[2, i]
                        alpha[pixel] = np.float32(1.0) - ray[3, i]
                        depth[pixel] = ray[4, i]

    def render(table, links, density, rows, lattice, count, camera, size, *rest):
        share_out(render_lines, (size[1] + 3) // 4, table, links, density, rows, lattice, count,
                  camera, size, *rest)
    return with_kernel(render, render_lines)


CAPACITY = 96  # Most rows that one pixel keeps; of a denser pixel the farthest are dropped.


@shared("wanted")
@kernel
def pixel_weights(since, until, table, links, density, lattice, camera, size, wanted, step, stop,
                  rows, weights, counts):
    """Fill rows, weights [P, CAPACITY] and counts [P] for the pixels ``wanted`` [P] (scan order).

    ``density`` is float32 [N + 1] with a zero last row; ``lattice``, ``camera`` and ``size`` are as
    for the render kernel.
    """
    nx, ny, nz = int(lattice[0]), int(lattice[1]), int(lattice[2])
    empty = len(density) - 1
    keys = np.full(1024, -1, np.int32)
    sums = np.zeros(1024, np.float32)
    used = np.empty(1024, np.int32)
    for index in range(since, until):
        pixel = wanted[index]
        cx = (pixel % size[0] + 0.5 - camera[14]) / camera[12]
        cy = (pixel // size[0] + 0.5 - camera[15]) / camera[13]
        scale = 1.0 / np.sqrt(cx * cx + cy * cy + 1.0)
        gx = (camera[0] * cx + camera[1] * cy + camera[2]) * scale * lattice[3]
        gy = (camera[4] * cx + camera[5] * cy + camera[6]) * scale * lattice[4]
        gz = (camera[8] * cx + camera[9] * cy + camera[10]) * scale * lattice[5]
        norm = np.sqrt(gx * gx + gy * gy + gz * gz)
        dx, dy, dz = gx / norm, gy / norm, gz / norm
        ox = camera[3] * lattice[3] + lattice[6]
        oy = camera[7] * lattice[4] + lattice[7]
        oz = camera[11] * lattice[5] + lattice[8]
        start, end = enter_box(np.float32(ox), np.float32(oy), np.float32(oz), np.float32(dx),
                               np.float32(dy), np.float32(dz), nx, ny, nz)
        delta = step / norm
        through, k, filled = 1.0, 0.0, 0
        t = float(start)
        while t < end and through > stop and filled < 900:
            px = min(max(ox + t * dx, 0.0), nx - 1.0)
            py = min(max(oy + t * dy, 0.0), ny - 1.0)
            pz = min(max(oz + t * dz, 0.0), nz - 1.0)
            ix, iy, iz = min(int(px), nx - 2), min(int(py), ny - 2), min(int(pz), nz - 2)
            brick = table[iz >> 2, iy >> 2, ix >> 2]
            if brick < 0:
                reach = 4.0 * (-brick - 1)
                leave = 1e30
                for axis in range(3):
                    p = px if axis == 0 else (py if axis == 1 else pz)
                    d = dx if axis == 0 else (dy if axis == 1 else dz)
                    i = ix if axis == 0 else (iy if axis == 1 else iz)
                    low = 4.0 * (i >> 2) - reach
                    high = 4.0 * (i >> 2) + 4.0 + reach
                    if d > 1e-9:
                        leave = min(leave, (high - p) / d)
                    elif d < -1e-9:
                        leave = min(leave, (low - p) / d)
                k += np.floor(max(leave, 0.0) / step) + 1.0
                t = start + k * step
                continue
            base = brick * 128 + (iz & 3) * 25 + (iy & 3) * 5 + (ix & 3)
            fx, fy, fz = px - ix, py - iy, pz - iz
            sigma = 0.0
            for corner in range(8):
                offset = (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1)
                share = ((fz if corner & 4 else 1.0 - fz) * (fy if corner & 2 else 1.0 - fy)
                         * (fx if corner & 1 else 1.0 - fx))
                sigma += share * density[links[base + offset]]
            if sigma > 1e-8:
                fade = np.exp(-sigma * delta)
                weight = through * (1.0 - fade)
                through *= fade
                if weight > 1e-4:
                    for corner in range(8):
                        offset = ((corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1))
                        share = ((fz if corner & 4 else 1.0 - fz)
                                 * (fy if corner & 2 else 1.0 - fy)
                                 * (fx if corner & 1 else 1.0 - fx))
                        row = links[base + offset]
                        if row != empty:
                            slot = (row * 40503) & 1023
                            while keys[slot] != -1 and keys[slot] != row:
                                slot = (slot + 1) & 1023
                            if keys[slot] == -1:
                                keys[slot] = row
                                used[filled] = slot
                                filled += 1
                            sums[slot] += np.float32(weight * share)
            k += 1.0
            t = start + k * step
        alpha = np.float32(1.0 - through)
        kept, mass = 0, np.float32(0.0)
        for item in range(filled):
            slot = used[item]
            value = sums[slot]
            if value > 1e-3 and kept < rows.shape[1]:
                rows[index, kept] = keys[slot]
                weights[index, kept] = value
                mass += value
                kept += 1
            keys[slot] = -1
            sums[slot] = 0.0
        if mass > 0.0:
            for item in range(kept):
                weights[index, item] *= alpha / mass
        counts[index] = kept


@kernel
def pose_equations(values, photo, depth, lens, usual, matrix, slope):
    """Add up one Gauss-Newton step's normal equations over a picture, Cauchy-weighted.

    A step turns the camera about its own axes by the first three numbers (radians) and moves it
    along them by the last three. Pictures' gradients are the mean of both pictures' (Malis 2004).

    Parameters
    ----------
    values, photo : float32 [H, W, C], the rendering and the photo.
    depth : float32 [H, W], along the optical axis in world units; pixels without one (not above
        zero, infinite) and those on the picture's border do not count.
    lens : Focal lengths x, y and principal point x, y in pixels.
    usual : Difference of a pixel's colors (root of the sum of squares) that is nothing unusual:
        twice as much counts half.
    matrix, slope : float64 [6, 6] and [6], out: sum of w J'J and of w J' (photo - rendering).

    Returns
    -------
    cost, count : Mean of Cauchy's log(1 + (difference / 2 usual)^2) over the pixels that count,
        and their number.
    """
    high, wide, channels = values.shape
    fx, fy, cx, cy = lens
    matrix[:] = 0.0
    slope[:] = 0.0
    row = np.zeros(6)
    cost, count, half = 0.0, 0, 0.25
    for y in range(1, high - 1):
        for x in range(1, wide - 1):
            z = depth[y, x]
            if not 0.0 < z < np.inf:
                continue
            u, v = (x + 0.5 - cx) / fx, (y + 0.5 - cy) / fy
            xx, xy, yy, ex, ey, size = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for c in range(channels):
                error = photo[y, x, c] - values[y, x, c]
                across = half * (values[y, x + 1, c] - values[y, x - 1, c]
                                 + photo[y, x + 1, c] - photo[y, x - 1, c])
                down = half * (values[y + 1, x, c] - values[y - 1, x, c]
                               + photo[y + 1, x, c] - photo[y - 1, x, c])
                xx += across * across
                xy += across * down
                yy += down * down
                ex += across * error
                ey += down * error
                size += error * error
            ratio = size / (4.0 * usual * usual)
            weight = 1.0 / (1.0 + ratio)
            cost += np.log(1.0 + ratio)
            count += 1
            # How the picture of the point moves: across by a, down by b for each of the six.
            a = (-fx * u * v, fx * (1.0 + u * u), -fx * v, fx / z, 0.0, -fx * u / z)
            b = (-fy * (1.0 + v * v), fy * u * v, fy * u, 0.0, fy / z, -fy * v / z)
            for i in range(6):
                slope[i] += weight * (a[i] * ex + b[i] * ey)
                row[i] = weight * (a[i] * xx + b[i] * xy)
            for i in range(6):
                along = weight * (a[i] * xy + b[i] * yy)
                for j in range(6):
                    matrix[i, j] += row[i] * a[j] + along * b[j]
    return cost / max(count, 1), count
