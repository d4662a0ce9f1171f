"""A grid that lists the few solids near each of its cells, and rays that walk through it.

A ray's steps are exact near surfaces and large elsewhere. The cells' lists lie one after the other
in one array, so that none can be too long.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from lfportrait.simd.decorators import kernel, lean
from lfportrait.simd.threads import share_out

from .design import Design
from .materials import CLEAR
from .solids import distance

__all__ = ["Baked", "bake", "march", "smooth_distance"]

BLOCK = 4  # cells a side of a block, whose solids are searched first


class Baked(NamedTuple):
    """A scene as the loops read it: see `Design`; distances, and the cells' lists with starts."""

    solids: np.ndarray
    profiles: np.ndarray
    materials: np.ndarray
    lights: np.ndarray
    ambient: np.ndarray
    grid: np.ndarray
    starts: np.ndarray
    listed: np.ndarray
    extent: float
    surroundings: int
    glassy: bool


@kernel
def search(first, last, solids, profiles, extent, grid, starts, listed, fill):
    """In some layers of blocks: distances at cells' middles, and what may be nearest in a cell.

    Without ``fill`` starts[c + 1] becomes the number of solids that cell c lists.
    """
    cells = len(grid)
    cell = 2.0 * extent / cells
    half, blocks = 0.5 * sqrt(3.0) * cell, cells // BLOCK
    for i in range(first, last):
        values, chosen = np.empty(len(solids)), np.empty(len(solids), np.int64)
        for rest in range(blocks * blocks):
            j, k = rest // blocks, rest % blocks
            x, y, z = (BLOCK * (i + 0.5) * cell - extent, BLOCK * (j + 0.5) * cell - extent,
                       BLOCK * (k + 0.5) * cell - extent)
            for s in range(len(solids)):
                values[s] = distance(solids, s, profiles, x, y, z)
            # A tenth more: the distance to a leaf is an estimate.
            bound, count = values.min() + 2.2 * BLOCK * half, 0
            for s in range(len(solids)):
                if values[s] <= bound:
                    chosen[count] = s
                    count += 1
            for inner in range(BLOCK**3):
                a = BLOCK * i + inner // BLOCK**2
                b, c = BLOCK * j + inner // BLOCK % BLOCK, BLOCK * k + inner % BLOCK
                number = (a * cells + b) * cells + c
                if fill and starts[number] == starts[number + 1]:
                    continue
                x, y, z = (a + 0.5) * cell - extent, (b + 0.5) * cell - extent, \
                    (c + 0.5) * cell - extent
                least = 1e9
                for n in range(count):
                    values[n] = distance(solids, chosen[n], profiles, x, y, z)
                    least = min(least, values[n])
                grid[a, b, c] = least
                near = 0
                if least < 2.0 * half:
                    for n in range(count):
                        if values[n] <= least + 2.0 * half:
                            if fill:
                                listed[starts[number] + near] = chosen[n]
                            near += 1
                if not fill:
                    starts[number + 1] = near


def bake(design: Design) -> Baked:
    """Search the solids near every cell."""
    cells = design.cells
    grid, starts = np.zeros((cells,) * 3, np.float32), np.zeros(cells**3 + 1, np.int32)
    listed = np.empty(0, np.int32)
    layers = cells // BLOCK
    share_out(search, layers, design.solids, design.profiles, design.extent, grid, starts, listed,
              False)
    starts = np.cumsum(starts, dtype=np.int32)
    listed = np.empty(starts[-1], np.int32)
    share_out(search, layers, design.solids, design.profiles, design.extent, grid, starts, listed,
              True)
    return Baked(design.solids, design.profiles, design.materials, design.lights, design.ambient,
                 grid, starts, listed, design.extent, design.surroundings,
                 bool((design.materials[:, CLEAR] > 0).any()))


@lean
def smooth_distance(grid, extent, x, y, z):
    """The grid's distance, interpolated: continuous, but blind to what is thinner than a cell."""
    cells = len(grid)
    scale, last = cells / (2.0 * extent), cells - 1.001
    fx = min(max((x + extent) * scale - 0.5, 0.0), last)
    fy = min(max((y + extent) * scale - 0.5, 0.0), last)
    fz = min(max((z + extent) * scale - 0.5, 0.0), last)
    i, j, k = int(fx), int(fy), int(fz)
    fx, fy, fz = fx - i, fy - j, fz - k
    total = 0.0
    for corner in range(8):
        a, b, c = corner >> 2, (corner >> 1) & 1, corner & 1
        total += ((fx if a else 1.0 - fx) * (fy if b else 1.0 - fy) * (fz if c else 1.0 - fz)
                  * grid[i + a, j + b, k + c])
    return total


@kernel
def march(baked, origin, direction, start, reach, softness, through_glass):
    """Walk along a ray: (distance or -1, solid, how much of a soft light passes by, and by glass).

    With ``through_glass`` glass does not end the walk.
    """
    extent, cells = baked.extent, len(baked.grid)
    first, last = start, reach
    for axis in range(3):
        slope = direction[axis] if abs(direction[axis]) > 1e-9 else 1e-9
        a, b = (-extent - origin[axis]) / slope, (extent - origin[axis]) / slope
        first, last = max(first, min(a, b)), min(last, max(a, b))
    cell = 2.0 * extent / cells
    t, light, dimmed = first + 1e-6, 1.0, 1.0
    while t < last:
        x, y = origin[0] + t * direction[0], origin[1] + t * direction[1]
        z = origin[2] + t * direction[2]
        i = min(max(int((x + extent) / cell), 0), cells - 1)
        j = min(max(int((y + extent) / cell), 0), cells - 1)
        k = min(max(int((z + extent) / cell), 0), cells - 1)
        number = (i * cells + j) * cells + k
        if baked.starts[number] == baked.starts[number + 1]:
            step = baked.grid[i, j, k] - 0.5 * sqrt(3.0) * cell
            clear = 1e9
            if softness > 0.0:
                clear = smooth_distance(baked.grid, extent, x, y, z)
        else:
            step, nearest, pane = 1e9, 0, 1e9
            for n in range(baked.starts[number], baked.starts[number + 1]):
                s = np.int64(baked.listed[n])
                if through_glass and baked.materials[int(baked.solids[s, 17]), CLEAR] > 0.0:
                    pane = min(pane, distance(baked.solids, s, baked.profiles, x, y, z))
                    continue
                # Most that are listed are no nearer than the nearest of those before.
                x0, y0, z0 = (x - baked.solids[s, 1], y - baked.solids[s, 2],
                              z - baked.solids[s, 3])
                bound = max(step, 0.0) + baked.solids[s, 20]
                if x0 * x0 + y0 * y0 + z0 * z0 > bound * bound:
                    continue
                value = distance(baked.solids, s, baked.profiles, x, y, z)
                if value < step:
                    step, nearest = value, s
            clear = step
            if step < 2e-4:
                return t, nearest, 0.0, 0.0
            if through_glass:  # what a cell lists may be glass only: not further than a cell
                step = min(step, 0.5 * cell)
            if pane < step:
                dimmed = min(dimmed, softness * max(pane, 0.0) / max(t - start, 1e-3))
                step = min(step, max(pane, 0.15 * cell))
        light = min(light, softness * clear / max(t - start, 1e-3))
        if light < 1e-3 and softness > 0.0:
            return t, 0, 0.0, 0.0
        t += max(step, 1e-4)
    return -1.0, 0, light, dimmed
