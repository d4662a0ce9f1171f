"""Coding a light field: one ray per sub-pixel, of which only its own channel is evaluated."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ...field.marching import (
    enter_box,
    make_channel_shade,
    make_detail,
    make_march,
    make_texture_share,
    sh_basis,
)
from ...lanes.cache_keys import identified
from ...lanes.decorators import kernel, lean_kernel
from ...lanes.threads import shared
from ...lanes.vectors import LANES

__all__ = ["encode_kernel", "eye_of", "side_of"]


@identified("eye_of")
@lean_kernel
def eye_of(place, y, eyes, panel):
    """Eye of sub-pixel ``place`` of row ``y`` at its own phase, between two views."""
    column, k = place // 3, place % 3
    step = panel[13 + 6 * (y % 4) + 3 * (column % 2) + k]
    raw = 3.0 * column + step + y * panel[10] + panel[11]
    phase = raw - panel[9] * np.floor(raw / panel[9])
    if phase >= panel[9]:
        phase = 0.0
    if panel[12] > 0.5 and phase > 0:
        phase = panel[9] - phase
    last = len(eyes) - 1
    at = min(max(phase / panel[9] * len(eyes) - 0.5, 0.0), float(last))
    return eyes[0] + (eyes[last] - eyes[0]) * at / max(last, 1)


@identified("side_of")
@lean_kernel
def side_of(place, y, across, panel):
    """X on the panel, in half panel heights, of sub-pixel ``place`` of row ``y``."""
    moved = panel[37 + 6 * (y % 4) + 3 * (place // 3 % 2) + place % 3]
    return panel[0] * (2.0 * (place + 0.5 + moved) / across - 1.0)


@functools.cache
def encode_kernel(width: int, count: int) -> Callable[..., Any]:
    """The kernel for color rows of 16 or 32 with ``count`` coefficients a channel.

    Returns
    -------
    encode
        ``encode(table, links, density, rows, cells, charts, texels, lattice, matrix, axes, mask,
        fixed, eyes, panel, step, threshold, stop, background, out)``. ``cells``, ``charts`` and
        ``texels`` are the field's texture (`VoxelField.texture_rows`). ``matrix``
        float64 [3, 4] takes the display frame to lattice coordinates, ``axes`` float64 [2, 3] are
        its x and z axes in the field's world (y is up in both). ``mask`` [H, W * 3] holds each
        sub-pixel's view; ``fixed`` >= 0 overrides it with one view; where ``eyes`` has one entry
        a sub-pixel phase instead
        (``panel[6]`` > 0), the view is continuous. ``panel`` float64 [61]: half width over half
        height, eye height, distance and placement scale, packed as [aspect, eye_y, distance, scale,
        first, rows, continuous, apart, bgr, pitch, shift, offset, inverted]; then, for each row mod
        4, column mod 2 and sub-pixel, its phase in its pixel (`Display.steps`), and how far it lies
        to the right of its usual third of the pixel, in sub-pixels. ``out`` uint8 [H, W * 3]. Its
        rows are those of the panel from ``first`` on, ``apart`` from each other; the panel has
        ``rows`` of them. Where ``background`` is below 0 it holds what is behind the field.
    """
    march = make_march(LANES, make_channel_shade(width, count))
    look_up, texture_share = make_detail(LANES, False), make_texture_share(LANES)
    load, store, ints = LANES.load, LANES.store, LANES.ints
    where, floats = LANES.where, LANES.floats

    @shared("out")
    @identified("encode", width, count)
    @kernel
    def encode(since, until, table, links, density, rows, cells, charts, texels, lattice, matrix,
               axes, mask, fixed, eyes, panel, step, threshold, stop, background, out):
        across = mask.shape[1]
        nx, ny, nz = np.int32(lattice[0]), np.int32(lattice[1]), np.int32(lattice[2])
        eye_y, distance, size = panel[1], panel[2], panel[3]
        continuous, bgr = panel[6] > 0.5, panel[8] > 0.5
        for y in range(since, until):
            basis = np.zeros(16 * 64, np.float32)
            scratch = np.zeros(16, np.float32)
            ray = np.zeros((10, 16), np.float32)
            flat = ray.reshape(160)
            line = int(panel[4]) + y * int(panel[7])
            py = 1.0 - 2.0 * (line + 0.5) / panel[5]
            for first in range(0, across, 16):
                for i in range(16):
                    place = min(first + i, across - 1)
                    if fixed >= 0:
                        ex = eyes[fixed]
                    elif continuous:
                        ex = eye_of(place, line, eyes, panel)
                    else:
                        ex = eyes[mask[y, place]]
                    px = side_of(place, line, across, panel)
                    wx, wy, wz = px - ex, py - eye_y, -distance
                    scale = 1.0 / np.sqrt(wx * wx + wy * wy + wz * wz)
                    wx, wy, wz = wx * scale, wy * scale, wz * scale
                    if count > 1:
                        sh_basis(np.float32(wx * axes[0, 0] + wz * axes[1, 0]), np.float32(wy),
                                 np.float32(wx * axes[0, 2] + wz * axes[1, 2]), scratch, 0, count)
                        for j in range(count):
                            basis[64 * i + j] = scratch[j]
                    else:
                        basis[64 * i] = np.float32(0.28209479177387814)
                    # Display frame to the field's lattice.
                    ox = matrix[0, 0] * ex + matrix[0, 2] * distance + matrix[0, 3]
                    oy = matrix[1, 1] * eye_y + matrix[1, 3]
                    oz = matrix[2, 0] * ex + matrix[2, 2] * distance + matrix[2, 3]
                    gx = matrix[0, 0] * wx + matrix[0, 2] * wz
                    gy = matrix[1, 1] * wy
                    gz = matrix[2, 0] * wx + matrix[2, 2] * wz
                    norm = np.sqrt(gx * gx + gy * gy + gz * gz)
                    dx, dy, dz = np.float32(gx / norm), np.float32(gy / norm), np.float32(gz / norm)
                    start, end = enter_box(np.float32(ox), np.float32(oy), np.float32(oz), dx, dy,
                                           dz, nx, ny, nz)
                    ray[0, i], ray[1, i], ray[2, i] = ox, oy, oz
                    ray[3, i], ray[4, i], ray[5, i] = dx, dy, dz
                    ray[6, i], ray[7, i] = start, end
                    ray[8, i] = np.float32(step / (norm * size))
                    channel = place % 3
                    ray[9, i] = np.float32(2 - channel if bgr else channel)
                value, _, _, through, where_half = march(
                    table, links, density, rows, nx, ny, nz, load(flat, 0), load(flat, 16),
                    load(flat, 32), load(flat, 48), load(flat, 64), load(flat, 80), load(flat, 96),
                    load(flat, 112), np.float32(step), load(flat, 128), np.float32(threshold),
                    np.float32(stop), basis, load(flat, 144))
                if len(cells) > 0:
                    share = texture_share(through)
                    wanted = share > np.float32(0.0)
                    # Without a surface it is infinite.
                    where_half = where(wanted, where_half, floats(np.float32(0.0)))
                    detail, _, _ = look_up(
                        table, cells, charts, texels, nx, ny, nz,
                        load(flat, 0) + where_half * load(flat, 48),
                        load(flat, 16) + where_half * load(flat, 64),
                        load(flat, 32) + where_half * load(flat, 80),
                        wanted, ints(load(flat, 144)))
                    value = value + share * detail
                store(flat, 0, value)
                store(flat, 16, through)
                for i in range(min(16, across - first)):
                    behind = background
                    if background < np.float32(0.0):
                        behind = np.float32(out[y, first + i]) * np.float32(1.0 / 255.0)
                    shown = ray[0, i] + ray[1, i] * behind
                    shown = min(max(shown, np.float32(0.0)), np.float32(1.0))
                    out[y, first + i] = np.uint8(shown * np.float32(255.0) + np.float32(0.5))
    return encode
