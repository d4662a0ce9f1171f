"""Which lattice rows a pixel sees, and how strongly: a view as a sparse linear map of colors.

With the density frozen and color independent of direction, a pixel is a weighted sum of the
colors at lattice points (Shen et al. 2023, Eq. 1 with trilinear interpolation). The kernel walks
each ray once and adds up every lattice row's weight in a small hash table.
"""

from __future__ import annotations

import numpy as np

from ...simd.decorators import kernel
from ...simd.threads import shared
from .march import enter_box

__all__ = ["CAPACITY", "pixel_weights"]

CAPACITY = 96
"""Most rows that one pixel keeps; of a denser pixel the farthest are dropped."""


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
