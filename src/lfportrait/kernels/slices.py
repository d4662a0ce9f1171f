"""Coding a light field row by row: all rays of a panel row lie in one plane.

The plane through the eyes' line and a row of the panel holds every ray of the row's sub-pixels,
whatever their views. So a row needs one slice of the field: density and colour where the plane cuts
the lattice planes z = k, interpolated between two rows of voxels. In the slice a ray is a straight
line x(k), and a sample on each lattice plane takes two values instead of eight.

A direction in the plane is one angle, phi, so that spherical harmonics of degree 2, nine
coefficients a channel, are a trigonometric polynomial with five: 1, cos phi, sin phi, sin 2 phi,
cos 2 phi. They are worked out once for each point of the slice.

Sixteen rays go through the planes together, front to back. Those that do are neighbours: within a
few lenses the sub-pixels are ordered by their view, so that a packet's rays stay close.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, prange

from .encode import eye_of
from .identity import identified
from .lanes import LANES
from .march import sh_basis
from .shuffles import make_restrict, store_half

__all__ = ["slice_kernel"]

_GROUP = 8
"""Planes that are skipped together where nothing of a packet's way lies in them."""
_WINDOW = 256
"""Neighbouring sub-pixels that are ordered by view."""


@identified("slice_matrix")
@njit(cache=True)
def slice_matrix(across, along, count, terms, matrix, scratch):
    """Spherical harmonics in the plane of two unit vectors, as coefficients of its angle.

    A direction is ``cos(phi) along + sin(phi) across``. ``matrix`` float32 [count * 16] is filled
    as `make_restrict` wants it; ``scratch`` float32 [5 * 16].
    """
    root = np.float32(np.sqrt(0.5))
    for probe in range(5):
        c = np.float32(1.0 if probe == 0 else (-1.0 if probe == 1 else 0.0))
        s = np.float32(1.0 if probe == 2 else (-1.0 if probe == 3 else 0.0))
        if probe == 4:
            c, s = root, root
        sh_basis(c * along[0] + s * across[0], c * along[1] + s * across[1],
                 c * along[2] + s * across[2], scratch, 16 * probe, count)
    matrix[:] = np.float32(0.0)
    half = np.float32(0.5)
    for part in range(count):
        ahead, back = scratch[part], scratch[16 + part]
        right, left, oblique = scratch[32 + part], scratch[48 + part], scratch[64 + part]
        cosine, sine = half * (ahead - back), half * (right - left)
        constant = np.float32(0.25) * (ahead + back + right + left)
        double = np.float32(0.25) * (ahead + back - right - left)
        mixed = oblique - constant - root * (cosine + sine)
        for channel in range(3):
            place = 16 * part + terms * channel
            matrix[place] = constant
            if terms > 1:
                matrix[place + 1], matrix[place + 2] = cosine, sine
            if terms > 3:
                matrix[place + 3], matrix[place + 4] = mixed, double


def _make_build(width: int, count: int, terms: int) -> Callable[..., Any]:
    """The function that fills one row's slice; returns nothing."""
    floats, ints, iota, where = LANES.floats, LANES.ints, LANES.iota, LANES.where
    gather, gather_pair, bits, lowest = LANES.gather, LANES.gather_pair, LANES.bits, LANES.lowest
    load_half, store, lane_of = LANES.load_half, LANES.store, LANES.lane
    minimum, maximum = LANES.minimum, LANES.maximum
    restrict = make_restrict(count, terms)
    two = width == 32
    one, zero = np.float32(1.0), np.float32(0.0)

    @identified("slice build", width, count, terms)
    @njit(cache=True)
    def build(table, links, density, rows, bounds, shape, plane, empty, matrix, cells, ids, coefs,
              low, high, stride):
        nx, ny, nz = shape[0], shape[1], shape[2]
        pitch = nx + 20
        used = 0
        for k in range(nz - 1, -1, -stride):
            # Forget what the last row left here.
            base = k * pitch + 2
            for i in range(low[k] - 2, high[k] + 19):
                cells[base + i] = 0
            low[k], high[k] = nx, -1
            bz = min(k >> 2, table.shape[0] - 1)
            start_y, step_y = plane[0] + plane[2] * k, plane[1]
            j0 = int(np.floor(min(start_y, start_y + step_y * nx)))
            j1 = int(np.floor(max(start_y, start_y + step_y * nx)))
            if j1 < 0 or j0 > ny - 2:
                continue
            first, last = nx, -1
            for by in range(max(j0, 0) >> 2, (min(j1, ny - 2) >> 2) + 1):
                first = min(first, bounds[bz, by, 0] * 4)
                last = max(last, bounds[bz, by, 1] * 4 + 4)
            last = min(last, nx - 1)
            before = -10
            inner_z = np.int32((k - 4 * bz) * 25)
            for x in range(first, last + 1, 16):
                i = iota() + np.int32(x)
                y = floats(i) * np.float32(step_y) + np.float32(start_y)
                fits = ((i <= np.int32(last)) & (y >= zero)
                        & (y <= np.float32(ny - 1)))
                i = minimum(i, np.int32(nx - 1))
                y = maximum(minimum(y, np.float32(ny - 1)), zero)
                j = minimum(ints(y), np.int32(ny - 2))
                part = y - floats(j)
                bx = minimum(i >> np.int32(2), np.int32(table.shape[2] - 1))
                by = j >> np.int32(2)
                brick = gather(table, (by + np.int32(bz * table.shape[1]))
                               * np.int32(table.shape[2]) + bx)
                fits = fits & (brick >= np.int32(0))
                if bits(fits) == 0:
                    continue
                slot = (maximum(brick, np.int32(0)) * np.int32(128) + inner_z
                        + (j - (by << np.int32(2))) * np.int32(5) + (i - (bx << np.int32(2))))
                row0, row1 = gather(links, slot), gather(links, slot + np.int32(5))
                found = fits & ((row0 != np.int32(empty)) | (row1 != np.int32(empty)))
                word = bits(found)
                if word == 0:
                    continue
                d0, _ = gather_pair(density, slot)
                d1, _ = gather_pair(density, slot + np.int32(5))
                store_half(cells, np.uintp(base + x), where(found, d0 + part * (d1 - d0), zero))
                while word != 0:
                    lane = lowest(word)
                    word &= word - np.uint32(1)
                    at = x + np.int64(lane)
                    if at > before + 1:
                        # Close the last run with an empty point, and open this one with one.
                        if before >= 0:
                            store(coefs, np.uintp(16 * used), floats(zero))
                            ids[base + before + 1] = used
                            used += 1
                        if before + 2 != at:
                            store(coefs, np.uintp(16 * used), floats(zero))
                            ids[base + at - 1] = used
                            used += 1
                    share = lane_of(part, lane)
                    place0 = np.uintp(lane_of(row0, lane)) * np.uintp(width)
                    place1 = np.uintp(lane_of(row1, lane)) * np.uintp(width)
                    head = ((one - share) * load_half(rows, place0)
                            + share * load_half(rows, place1))
                    rest = head
                    if two:
                        rest = ((one - share) * load_half(rows, place0 + np.uintp(16))
                                + share * load_half(rows, place1 + np.uintp(16)))
                    store(coefs, np.uintp(16 * used), restrict(head, rest, matrix))
                    ids[base + at] = used
                    used += 1
                    before = at
                    low[k] = min(low[k], at)
                    high[k] = at
            if before >= 0:
                store(coefs, np.uintp(16 * used), floats(zero))
                ids[base + before + 1] = used
                used += 1
    return build


def _make_cast(count: int, terms: int) -> Callable[..., Any]:
    """The function that sends one packet through a slice; returns colour and transmittance."""
    floats, ints, where, exp = LANES.floats, LANES.ints, LANES.where, LANES.exp
    gather, gather_pair, bits = LANES.gather, LANES.gather_pair, LANES.bits
    minimum, maximum = LANES.minimum, LANES.maximum
    one, zero = np.float32(1.0), np.float32(0.0)

    @identified("slice term", count, terms)
    @njit(cache=True)
    def _term(coefs, place, part):
        first = gather(coefs, place)
        return first + part * (gather(coefs, place + np.int32(16)) - first)

    @identified("slice cast", count, terms)
    @njit(cache=True)
    def cast(cells, ids, coefs, low, high, group_low, group_high, planes, pitch, stride, start,
             slope, delta, cosine, sine, channel, threshold, stop):
        value, through = floats(zero), floats(one)
        alive = through > zero
        double_sine = np.float32(2.0) * sine * cosine
        double_cosine = one - np.float32(2.0) * sine * sine
        for group in range(len(group_low)):
            if group_low[group] > group_high[group]:
                continue
            front = planes - 1 - group * _GROUP * stride
            back = max(front - (_GROUP - 1) * stride, 0)
            at_front = start + slope * np.float32(front)
            at_back = start + slope * np.float32(back)
            left, right = np.float32(group_low[group] - 1), np.float32(group_high[group] + 1)
            if bits(alive & (maximum(at_front, at_back) > left)
                    & (minimum(at_front, at_back) < right)) == 0:
                continue
            for k in range(front, back - 1, -stride):
                if low[k] > high[k]:
                    continue
                x = maximum(minimum(start + slope * np.float32(k), np.float32(high[k] + 1)),
                            np.float32(low[k] - 1))
                cell = ints(x + one) - np.int32(1)
                part = x - floats(cell)
                cell = cell + np.int32(k * pitch + 2)
                before, after = gather_pair(cells, cell)
                sigma = before + part * (after - before)
                shown = alive & (sigma > threshold)
                if bits(shown) == 0:
                    continue
                fade = where(shown, exp(-(sigma * delta)), one)
                place = where(shown, gather(ids, cell), np.int32(0)) * np.int32(16) + channel
                color = _term(coefs, place, part)
                if terms > 1:
                    color = color + cosine * _term(coefs, place + np.int32(1), part)
                    color = color + sine * _term(coefs, place + np.int32(2), part)
                if terms > 3:
                    color = color + double_sine * _term(coefs, place + np.int32(3), part)
                    color = color + double_cosine * _term(coefs, place + np.int32(4), part)
                weight = through * (one - fade)
                value = value + weight * maximum(color + np.float32(0.5), zero)
                through = through * fade
                alive = alive & (through > stop)
                if bits(alive) == 0:
                    return value, through
        return value, through

    return cast


@functools.cache
def slice_kernel(width: int, count: int) -> Callable[..., Any]:
    """The kernel for colour rows of 16 or 32 with ``count`` coefficients a channel.

    Returns
    -------
    encode
        ``encode(table, links, density, rows, bounds, lattice, matrix, mask, fixed, eyes, panel,
        stride, threshold, stop, background, workers, out)``: as `encode_kernel` has it, but
        ``bounds`` int32 [BZ, BY, 2] gives the first and last brick of each row of ``table``
        (first > last: none), ``matrix`` float64 [3, 4] takes the display frame to lattice
        coordinates (only its second row may depend on y, and that on nothing else),
        ``axes`` float64 [2, 3] the display's x and z axes in the field's world, ``stride`` is the
        number of lattice planes to a sample and ``workers`` the number of threads.
    """
    terms = {1: 1, 4: 3, 9: 5}[count]
    build, cast = _make_build(width, count, terms), _make_cast(count, terms)
    load, store, floats, ints = LANES.load, LANES.store, LANES.floats, LANES.ints
    sqrt = LANES.sqrt

    @identified("slice order", width, count)
    @njit(cache=True)
    def _order(mask, begin, many, fixed, eyes, y, panel, tally, place_at, eye_at):
        """Sub-pixels of a window in the order of their views, with their eyes."""
        if fixed >= 0:
            for entry in range(many):
                place_at[entry], eye_at[entry] = begin + entry, np.float32(eyes[fixed])
            return
        tally[:] = 0
        for place in range(begin, begin + many):
            tally[mask[place] + 1] += 1
        for view in range(1, len(tally)):
            tally[view] += tally[view - 1]
        continuous = panel[6] > 0.5
        for place in range(begin, begin + many):
            view = mask[place]
            entry = tally[view]
            tally[view] += 1
            place_at[entry] = place
            eye_at[entry] = np.float32(eye_of(place, y, eyes, panel) if continuous else eyes[view])

    @identified("slice encode", width, count)
    @njit(cache=True, parallel=True)
    def encode(table, links, density, rows, bounds, lattice, matrix, axes, mask, fixed, eyes, panel,
               stride, threshold, stop, background, workers, out):
        height, across = mask.shape
        nx, ny, nz = np.int64(lattice[0]), np.int64(lattice[1]), np.int64(lattice[2])
        empty = len(rows) // width - 1 - 32 // width
        aspect, eye_y, distance, size = panel[0], panel[1], panel[2], panel[3]
        bgr = panel[8] > 0.5
        pitch = nx + 20
        views = len(eyes)
        # Depth and x in the display frame of a point of the slice (i, k).
        det = matrix[0, 0] * matrix[2, 2] - matrix[0, 2] * matrix[2, 0]
        depth_i, depth_k = -matrix[2, 0] / det, matrix[0, 0] / det
        depth_0 = -depth_i * matrix[0, 3] - depth_k * matrix[2, 3]
        side_i, side_k = matrix[2, 2] / det, -matrix[0, 2] / det
        side_0 = -side_i * matrix[0, 3] - side_k * matrix[2, 3]
        shape = np.array([nx, ny, nz])
        groups = (nz + _GROUP * stride - 1) // (_GROUP * stride)
        blank = np.uint8(min(max(background, np.float32(0.0)), np.float32(1.0))
                         * np.float32(255.0) + np.float32(0.5))
        for worker in prange(workers):
            cells, ids = np.zeros(nz * pitch + 64, np.uint16), np.zeros(nz * pitch + 64, np.int32)
            coefs = np.empty(16 * (2 * nx * ((nz + stride - 1) // stride) + 64), np.float32)
            low, high = np.full(nz, nx), np.full(nz, -1)
            group_low, group_high = np.zeros(groups, np.int64), np.zeros(groups, np.int64)
            basis, scratch = np.zeros(count * 16, np.float32), np.zeros(80, np.float32)
            plane, along = np.zeros(3), np.zeros(3, np.float32)
            side = axes[0].astype(np.float32)
            eye_at, x_at = np.zeros(_WINDOW + 16, np.float32), np.zeros(_WINDOW + 16, np.float32)
            channel_at, lane = np.zeros(_WINDOW + 16, np.float32), np.zeros(32, np.float32)
            place_at = np.zeros(_WINDOW + 16, np.int64)
            tally = np.zeros(views + 1, np.int64)
            for y in range(worker, height, workers):
                row = out[y]
                row[:] = blank
                py = 1.0 - 2.0 * (y + 0.5) / height
                rise = eye_y - py
                # The plane cuts (i, k) at lattice row plane[0] + plane[1] i + plane[2] k.
                lift = matrix[1, 1] * rise / distance
                plane[0] = matrix[1, 1] * py + matrix[1, 3] + lift * depth_0
                plane[1], plane[2] = lift * depth_i, lift * depth_k
                norm = np.sqrt(rise * rise + distance * distance)
                for axis in range(3):
                    up = 1.0 if axis == 1 else 0.0
                    along[axis] = np.float32((-rise * up - distance * axes[1, axis]) / norm)
                slice_matrix(side, along, count, terms, basis, scratch)
                build(table, links, density, rows, bounds, shape, plane, empty, basis, cells, ids,
                      coefs, low, high, stride)
                # Where the panel shows any of it: between the outermost rays of all eyes.
                left, right = 1e9, -1e9
                for group in range(groups):
                    group_low[group], group_high[group] = nx, -1
                    front = nz - 1 - group * _GROUP * stride
                    for k in range(front, max(front - _GROUP * stride, -1), -stride):
                        if low[k] > high[k]:
                            continue
                        group_low[group] = min(group_low[group], low[k])
                        group_high[group] = max(group_high[group], high[k])
                        for end in (low[k] - 1, high[k] + 1):
                            depth = (depth_i * end + depth_k * k + depth_0) / distance
                            for eye in (eyes[0], eyes[views - 1]):
                                px = (side_i * end + side_k * k + side_0 - eye * depth) / (
                                    1.0 - depth)
                                left, right = min(left, px), max(right, px)
                if left > right:
                    continue
                first = max(0, int(np.floor((left / aspect + 1.0) * across / 2.0)))
                last = min(across, int(np.ceil((right / aspect + 1.0) * across / 2.0)) + 1)
                for begin in range(first, last, _WINDOW):
                    many = min(_WINDOW, last - begin)
                    _order(mask[y], begin, many, fixed, eyes, y, panel, tally, place_at, eye_at)
                    for entry in range(many):
                        place = place_at[entry]
                        x_at[entry] = np.float32(aspect * (2.0 * (place + 0.5) / across - 1.0))
                        channel = place % 3
                        channel_at[entry] = np.float32(
                            terms * (2 - channel if bgr else channel))
                    for entry in range(many, min(many + 16, _WINDOW + 16)):
                        eye_at[entry], x_at[entry] = eye_at[many - 1], x_at[many - 1]
                        channel_at[entry] = channel_at[many - 1]
                    for entry in range(0, many, 16):
                        px, ex = load(x_at, np.uintp(entry)), load(eye_at, np.uintp(entry))
                        sideways = ex - px
                        length = sqrt(sideways * sideways + np.float32(norm * norm))
                        deep = (np.float32(matrix[2, 0]) * sideways
                                + np.float32(matrix[2, 2] * distance))
                        slope = (np.float32(matrix[0, 0]) * sideways
                                 + np.float32(matrix[0, 2] * distance)) / deep
                        at_panel = np.float32(matrix[2, 0]) * px + np.float32(matrix[2, 3])
                        start = (np.float32(matrix[0, 0]) * px + np.float32(matrix[0, 3])
                                 - slope * at_panel)
                        delta = length * np.float32(stride / size) / deep
                        value, through = cast(
                            cells, ids, coefs, low, high, group_low, group_high, nz, pitch, stride,
                            start, slope, delta, np.float32(norm) / length,
                            floats(np.float32(0.0)) - sideways / length,
                            ints(load(channel_at, np.uintp(entry))), np.float32(threshold),
                            np.float32(stop))
                        store(lane, np.uintp(0), value + through * background)
                        for i in range(min(16, many - entry)):
                            shown = min(max(lane[i], np.float32(0.0)), np.float32(1.0))
                            row[place_at[entry + i]] = np.uint8(
                                shown * np.float32(255.0) + np.float32(0.5))

    return encode
