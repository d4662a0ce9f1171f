"""Rendering level cameras row by row: all rays of a picture's row lie in one plane.

A camera that is neither rolled nor raised sees, along a row, a plane through its own right axis. In
it lie the same rows of all cameras beside it that look the same way, as those of a quilt do. So one
slice of the field (see `slices`) serves them all. Here a packet is 16 pixels of a row, and follows
all three channels.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ...lanes.cache_keys import identified
from ...lanes.decorators import kernel, lean
from ...lanes.threads import shared
from ...lanes.vectors import LANES
from .cast import GROUP, make_cast
from .plane import plane_matrix
from .slab import LINES, make_build, pitch_of

__all__ = ["view_kernel"]


@identified("view columns")
@lean
def _columns(camera, lattice, low, high, back, front, width):
    """First pixel, and first beyond, that may show columns low to high of planes back to front."""
    left, right = 1e9, -1e9
    for corner in range(4):
        i, k = (low if corner & 1 else high), (back if corner & 2 else front)
        x = (i - lattice[6]) / lattice[3] - camera[3]
        z = (k - lattice[8]) / lattice[5] - camera[11]
        ahead = camera[2] * x + camera[10] * z
        place = camera[12] * (camera[0] * x + camera[8] * z) / ahead + camera[14]
        left, right = min(left, place), max(right, place)
    return max(0, int(np.floor(left)) - 1), min(width, int(np.ceil(right)) + 1)


@functools.cache
def view_kernel(count: int, permutes: bool | None = None) -> Callable[..., Any]:
    """The kernel for colors of ``count`` coefficients a channel.

    ``permutes`` chooses between two ways to read a slice (see `make_look_up`).

    Returns
    -------
    render
        ``render(places, occupied, values, lattice, cameras, least, stride, threshold, stop,
        workers, color, alpha, depth)``: the field's `Stretches`; ``cameras`` float64 [V, 16], pose
        row by row, focal x, y, principal point x, y, of cameras that differ only by what lies along
        their right axis: eye, focal x and principal x. That axis is level, and the lattice lies
        before all of them, so that rays go from its last plane to its first. ``least`` is the least
        cosine, in a row's plane, between a ray and the middle; ``stride``, ``threshold``, ``stop``
        and ``workers`` are as `slice_kernel` has them. It fills ``color`` float32 [V, H, W, 3]
        without background, ``alpha`` [V, H, W] and ``depth`` [V, H, W] (along the optical axis,
        infinite where half the light passes).
    """
    build, cast = make_build(count), make_cast(count, permutes, 3)
    store, iota, floats = LANES.store, LANES.iota, LANES.floats
    sqrt, where = LANES.sqrt, LANES.where

    @identified("view row", count, permutes)
    @lean
    def _row(slab, marks, group_marks, nx, nz, shift, stride, camera, lattice, norm, begin, end,
             threshold, stop, lane, color, alpha, depth):
        """A row of one picture, from pixel ``begin`` to ``end``."""
        # In the lattice, where the eye is, and the way of the ray with slope 0 and what each unit
        # of slope adds to it.
        eye_i = np.float32(camera[3] * lattice[3] + lattice[6])
        eye_k = np.float32(camera[11] * lattice[5] + lattice[8])
        ahead_i, ahead_k = camera[2] * lattice[3], camera[10] * lattice[5]
        across_i, across_k = camera[0] * lattice[3], camera[8] * lattice[5]
        for x in range(begin, end, 16):
            side = (floats(iota()) + np.float32(x + 0.5 - camera[14])) * np.float32(1 / camera[12])
            length = sqrt(side * side + np.float32(norm * norm))
            inverse = np.float32(1.0) / (side * np.float32(across_k) + np.float32(ahead_k))
            slope = (side * np.float32(across_i) + np.float32(ahead_i)) * inverse
            start = eye_i - slope * eye_k
            red, green, blue, through, plane = cast(
                slab, marks, group_marks, nx, nz, shift, stride, start, slope,
                length * inverse * np.float32(-stride), np.float32(norm) / length, side / length,
                1, threshold, stop)
            store(lane, np.uintp(0), red)
            store(lane, np.uintp(16), green)
            store(lane, np.uintp(32), blue)
            store(lane, np.uintp(48), through)
            away = where(through < np.float32(0.5), (plane - eye_k) * inverse,
                         floats(np.float32(np.inf)))
            store(lane, np.uintp(64), away)
            for i in range(min(16, end - x)):
                color[x + i, 0] = lane[i]
                color[x + i, 1] = lane[16 + i]
                color[x + i, 2] = lane[32 + i]
                alpha[x + i] = np.float32(1.0) - lane[48 + i]
                depth[x + i] = lane[64 + i]

    @shared("workers")
    @identified("view render", count, permutes)
    @kernel
    def render(since, until, places, occupied, values, lattice, cameras, least, stride, threshold,
               stop, workers, color, alpha, depth):
        views, height, across = alpha.shape
        nx, ny, nz = np.int64(lattice[0]), np.int64(lattice[1]), np.int64(lattice[2])
        pitch = pitch_of(nx)
        shift = 0
        while (nx >> shift) > 63:
            shift += 1
        shape = np.array([nx, ny, nz])
        groups = (nz + GROUP * stride - 1) // (GROUP * stride)
        one = cameras[0]
        # Distance along the optical axis of the lattice's point (i, k).
        depth_i, depth_k = one[2] / lattice[3], one[10] / lattice[5]
        depth_0 = -(depth_i * lattice[6] + depth_k * lattice[8]
                    + one[2] * one[3] + one[10] * one[11])
        for worker in range(since, until):
            slab = np.zeros(nz * LINES * pitch, np.uint16)
            low, high = np.full(nz, nx), np.full(nz, -1)
            marks, group_marks = np.zeros(nz, np.uint64), np.zeros(groups, np.uint64)
            basis, scratch = np.zeros(count * 16, np.float32), np.zeros(80, np.float32)
            plane, along, side = np.zeros(3), np.zeros(3, np.float32), np.zeros(3, np.float32)
            lane = np.zeros(80, np.float32)
            for axis in range(3):
                side[axis] = one[4 * axis]
            for y in range(worker, height, workers):
                color[:, y] = np.float32(0.0)
                alpha[:, y] = np.float32(0.0)
                depth[:, y] = np.float32(np.inf)
                fall = (y + 0.5 - one[15]) / one[13]
                # The plane cuts (i, k) at lattice row plane[0] + plane[1] i + plane[2] k.
                lift = one[5] * fall * lattice[4]
                plane[0] = one[7] * lattice[4] + lattice[7] + lift * depth_0
                plane[1], plane[2] = lift * depth_i, lift * depth_k
                norm = np.sqrt(1.0 + fall * fall)
                for axis in range(3):
                    along[axis] = np.float32(
                        (one[4 * axis + 2] + fall * one[4 * axis + 1]) / norm)
                plane_matrix(side, along, count, least, basis, scratch)
                build(places, occupied, values, shape, plane, basis, threshold, shift, stride, slab,
                      low, high, marks)
                left, right, back, front = nx, -1, nz, -1
                for group in range(groups):
                    group_marks[group] = 0
                    first = nz - 1 - group * GROUP * stride
                    for k in range(first, max(first - GROUP * stride, -1), -stride):
                        if marks[k] == 0:
                            continue
                        group_marks[group] |= marks[k]
                        left, right = min(left, low[k]), max(right, high[k])
                        back, front = min(back, k), max(front, k)
                if front < 0:
                    continue
                for view in range(views):
                    begin, end = _columns(cameras[view], lattice, left - 1, right + 1, back, front,
                                          across)
                    _row(slab, marks, group_marks, nx, nz, shift, stride, cameras[view], lattice,
                         norm, begin, end, threshold, stop, lane, color[view, y], alpha[view, y],
                         depth[view, y])

    return render
