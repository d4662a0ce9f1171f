"""Rendering a pinhole view: packets of 4x4 pixels cast through bricks."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ...simd.decorators import identified, kernel
from ...simd.threads import share_out, with_kernel
from ...simd.vectors import LANES, SCALAR
from .march import enter_box, make_basis, make_march, make_rgb_shade

__all__ = ["render_kernel", "render_kernel_one_lane"]


@functools.cache
def render_kernel(width: int) -> Callable[..., Any]:
    """The kernel for color rows of 16 or 32; of 0: it leaves colors alone, and needs no rows.

    Returns
    -------
    render
        ``render(table, links, density, rows, lattice, count, camera, size, step, threshold, stop,
        color, alpha, depth)`` with ``lattice`` float64 [9] (points along x, y, z; scale and offset
        of the lattice per world unit), ``camera`` float64 [16] (pose row by row, focal x, y,
        principal point x, y), ``size`` (width, height); it fills ``color`` float32 [H W 3] without
        background, ``alpha`` [H W] and ``depth`` [H W] (along the optical axis).
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


@functools.cache
def render_kernel_one_lane(width: int) -> Callable[..., Any]:
    """One ray at a time from the same marching loop: the shape that a GPU thread has.

    Returns
    -------
    cast
        ``cast(table, links, density, rows, lattice, count, origin, direction, step, delta,
        threshold, stop)`` for one ray in lattice units with its unit world direction in
        ``direction[3:]``; returns (r, g, b, transmittance, lattice distance of the surface).
    """
    half, zero = SCALAR.half, np.float32(0.0)

    @identified("one-lane shade", width)
    @kernel
    def shade(links, rows, base, weights, lane, basis, channel):
        count = np.int64(channel)
        color = (zero, zero, zero)
        sums = np.zeros(3, np.float32)
        for corner in range(8):
            offset = (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1)
            row = links[base + offset] * width
            for c in range(3):
                for i in range(count):
                    sums[c] += weights[corner] * half(rows[row + c * count + i]) * basis[i]
        color = (max(sums[0] + np.float32(0.5), zero), max(sums[1] + np.float32(0.5), zero),
                 max(sums[2] + np.float32(0.5), zero))
        return color

    march = make_march(SCALAR, shade)

    @identified("one-lane cast", width)
    @kernel
    def cast(table, links, density, rows, lattice, count, origin, direction, basis, step, delta,
             threshold, stop):
        nx, ny, nz = np.int32(lattice[0]), np.int32(lattice[1]), np.int32(lattice[2])
        start, end = enter_box(origin[0], origin[1], origin[2], direction[0], direction[1],
                               direction[2], nx, ny, nz)
        return march(table, links, density, rows, nx, ny, nz, origin[0], origin[1], origin[2],
                     direction[0], direction[1], direction[2], start, end, np.float32(step),
                     np.float32(delta), np.float32(threshold), np.float32(stop), basis,
                     np.float32(count))
    return cast
