"""The local copy of the lattice that a packet of training rays works on.

Sixteen rays of neighbouring pixels meet a few dozen bricks and a few hundred lattice points, again
and again. So every brick that a packet enters is *opened* once: its densities are copied side by
side; and every point that colors a sample gets its color once, for the packet's middle direction.
Samples then mix three numbers a corner where a row has up to 27, and going backward they leave
five: the slopes of the point's three colors, the weight of the rays that it colors, and its
density's slope. At the end of a packet these go to the lattice, as one *record* a point.

A point's place in the pad is 128 times the number of its brick in the pad, plus its place in the
brick (`bricks`). Colors and slopes have eight floats a point, so that the two corners along x are
one vector.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import Array, Float32, Int32, Int64
from ...simd.decorators import identified, lean
from ...simd.interleaved import gather_signed, load_ints, prefetch
from ...simd.vectors import LANES

_floats, _where, _iota, _lane = LANES.floats, LANES.where, LANES.iota, LANES.lane
_load, _store, _total = LANES.load, LANES.store, LANES.total
_one, _zero, _half = np.float32(1.0), np.float32(0.0), np.float32(0.5)
_POINT, _CELL = np.uint8(1), np.uint8(2)
"""Marks of a point that has its color, and of a cell (by its first corner) whose corners have."""
OWNED = 64  # Rows side by side that belong to one worker: row / 64 modulo the number of workers.
_HASH = 4096
_AHEAD = 12  # Points that rows are asked for ahead.


def make_pad(workers: int, table: Int32, bricks: int) -> tuple[Array, ...]:
    """Scratch of all workers; pages that no packet reaches cost nothing.

    Parameters
    ----------
    workers : Number of workers, the leading axis.
    table : The brick table: sixteen straight rays enter no more bricks than sixteen times its
        sides.

    Returns
    -------
    pad : ``place`` int32 [W, bricks], number in the pad of each brick, -1 outside packets;
        ``opened`` int32 [W, C] the bricks; ``density`` float32 [W, 128 C + 32]; ``colors`` and
        ``slopes`` float32 [W, 1024 C + 512]; ``ready`` uint8 [W, 128 C]; ``used`` int32 [W, 128
        C], points that have their color; ``counts`` int64 [W, 8], of opened bricks and of used
        points.
    """
    room = max(1, min(bricks, 16 * (sum(table.shape) + 3)))
    return (np.full((workers, max(1, bricks)), -1, np.int32), np.empty((workers, room), np.int32),
            np.empty((workers, 128 * room + 32), np.float32),
            np.empty((workers, 1024 * room + 512), np.float32),
            np.empty((workers, 1024 * room + 512), np.float32),
            np.empty((workers, 128 * room), np.uint8), np.empty((workers, 128 * room), np.int32),
            np.zeros((workers, 8), np.int64))


@dataclass
class Records:
    """Gradients that packets pass to the lattice, sorted by the thread that adds them."""

    # int32 [W, W, room, 2]: row and tile of each record, by the worker that wrote it and the one
    # that owns the row.
    keys: Int32
    # float32 [W, W, room, 5]: slopes of red, green and blue, weight of the rays, slope of the
    # density.
    values: Float32
    counts: Int64  # int64 [W, W], records written; more than there was room for if some were lost.
    recent: Int32  # int32 [W, 4096], scratch: where a row's last record may be.

    @staticmethod
    def empty(workers: int, room: int) -> Records:
        """Room for so many records of each pair of workers."""
        return Records(np.empty((workers, workers, room, 2), np.int32),
                       np.empty((workers, workers, room, 5), np.float32),
                       np.zeros((workers, workers), np.int64),
                       np.zeros((workers, _HASH), np.int32))

    @property
    def arrays(self) -> tuple[Array, ...]:
        """Keys, values, counts, recent: what kernels take."""
        return self.keys, self.values, self.counts, self.recent

    def grown(self) -> Records | None:
        """Larger ones if there was too little room for the last step, else None."""
        needed, room = int(self.counts.max()), self.keys.shape[2]
        return Records.empty(len(self.keys), needed * 3 // 2) if needed > room else None


@identified("packet open brick")
@lean
def open_brick(brick, links, density, place, opened, own_density, ready, counts):
    """Copy a brick's densities into the pad, unless they are there."""
    if place[np.uintp(brick)] >= 0:
        return
    number = counts[0]
    counts[0] = number + 1
    place[np.uintp(brick)] = number
    opened[np.uintp(number)] = brick
    for part in range(8):
        start = np.uintp(128 * number + 16 * part)
        rows = load_ints(links, np.uintp(128 * np.int64(brick) + 16 * part))
        _store(own_density, start, gather_signed(density, rows))
        for slot in range(16):
            ready[start + np.uintp(slot)] = np.uint8(0)


@identified("packet mix density")
@lean
def mix_density(own_density, base, fx, fy, fz):
    """Density in the cells ``base`` of the pad, 16 lanes."""
    d000 = gather_signed(own_density, base)
    d001 = gather_signed(own_density, base + np.int32(1))
    d010 = gather_signed(own_density, base + np.int32(5))
    d011 = gather_signed(own_density, base + np.int32(6))
    d100 = gather_signed(own_density, base + np.int32(25))
    d101 = gather_signed(own_density, base + np.int32(26))
    d110 = gather_signed(own_density, base + np.int32(30))
    d111 = gather_signed(own_density, base + np.int32(31))
    d00, d01 = d000 + fx * (d001 - d000), d010 + fx * (d011 - d010)
    d10, d11 = d100 + fx * (d101 - d100), d110 + fx * (d111 - d110)
    d0, d1 = d00 + fy * (d01 - d00), d10 + fy * (d11 - d10)
    return d0 + fz * (d1 - d0)


@identified("packet use cell")
@lean
def use_cell(cell, ready, used, counts):
    """Note the corners of a cell that need colors and have none yet."""
    if ready[np.uintp(cell)] & _CELL:
        return
    ready[np.uintp(cell)] |= _CELL
    for corner in range(8):
        point = np.uintp(cell + (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1))
        if ready[point] & _POINT == 0:
            ready[point] |= _POINT
            used[np.uintp(counts[1])] = point
            counts[1] += 1


@identified("packet row of")
@lean
def _row_of(point, links, opened):
    """The lattice's row of a point in the pad."""
    brick = np.uintp(opened[point >> np.uintp(7)])
    return links[(brick << np.uintp(7)) + (point & np.uintp(127))]


def make_color_points(width: int) -> Callable[..., Any]:
    """A function that gives all noted points their colors, for rows of 16 or 32 floats."""
    two = width == 32

    @identified("packet color points", width)
    @lean
    def color_points(links, rows, opened, basis, colors, slopes, used, counts):
        count = counts[1]
        for number in range(-_AHEAD, count):
            # Rows lie far apart in memory: each is asked for well before it is needed.
            if number + _AHEAD < count:
                ahead = np.uintp(used[np.uintp(number + _AHEAD)])
                start = np.uintp(_row_of(ahead, links, opened)) * np.uintp(width)
                prefetch(rows, start)
                if two:
                    prefetch(rows, start + np.uintp(16))
            if number < 0:
                continue
            point = np.uintp(used[np.uintp(number)])
            start = np.uintp(_row_of(point, links, opened)) * np.uintp(width)
            first = _load(rows, start)
            red = _total(first * _load(basis, np.uintp(0)))
            if two:
                rest = _load(rows, start + np.uintp(16))
                green = _total(first * _load(basis, np.uintp(16))
                               + rest * _load(basis, np.uintp(32)))
                blue = _total(rest * _load(basis, np.uintp(48)))
            else:
                green = _total(first * _load(basis, np.uintp(16)))
                blue = _total(first * _load(basis, np.uintp(32)))
            at = point << np.uintp(3)
            colors[at] = red + _half
            colors[at + np.uintp(1)] = green + _half
            colors[at + np.uintp(2)] = blue + _half
            for value in range(5):
                slopes[at + np.uintp(value)] = _zero
    return color_points


@identified("packet shares")
@lean
def _shares(x, y, z):
    """Shares of the corners along y and z, and a vector of those along x."""
    along = _where(_iota() < np.int32(8), _floats(_one - x), _floats(x))
    return (_one - z) * (_one - y), (_one - z) * y, z * (_one - y), z * y, along


@identified("packet mix color")
@lean
def mix_color(cell, x, y, z, colors):
    """Color in a cell whose corners have theirs, below zero where those are."""
    near, high, deep, both, along = _shares(x, y, z)
    at = np.uintp(cell) << np.uintp(3)
    mixed = along * (near * _load(colors, at) + high * _load(colors, at + np.uintp(40))
                     + deep * _load(colors, at + np.uintp(200))
                     + both * _load(colors, at + np.uintp(240)))
    return (_lane(mixed, 0) + _lane(mixed, 8), _lane(mixed, 1) + _lane(mixed, 9),
            _lane(mixed, 2) + _lane(mixed, 10))


@identified("packet scatter")
@lean
def scatter(cell, x, y, z, red, green, blue, weight, sigma, slopes):
    """Share a sample's slopes out to its cell's corners."""
    near, high, deep, both, along = _shares(x, y, z)
    place = _iota() & np.int32(7)
    own = along * _where(place == np.int32(0), _floats(red), _where(
        place == np.int32(1), _floats(green), _where(
            place == np.int32(2), _floats(blue), _where(
                place == np.int32(3), _floats(weight), _where(
                    place == np.int32(4), _floats(sigma), _floats(_zero))))))
    at = np.uintp(cell) << np.uintp(3)
    _store(slopes, at, _load(slopes, at) + near * own)
    at += np.uintp(40)
    _store(slopes, at, _load(slopes, at) + high * own)
    at += np.uintp(160)
    _store(slopes, at, _load(slopes, at) + deep * own)
    at += np.uintp(40)
    _store(slopes, at, _load(slopes, at) + both * own)


@identified("packet write records")
@lean
def write_records(tile, links, empty, opened, used, slopes, counts, keys, values, written, recent):
    """One record for each point that the packet used.

    A point on the border of two bricks is in the pad twice; its slopes go to one record.
    """
    workers = len(written)
    for number in range(counts[1]):
        point = np.uintp(used[np.uintp(number)])
        row = _row_of(point, links, opened)
        if row == empty:
            continue
        owner = np.uintp(row) // np.uintp(OWNED) % np.uintp(workers)
        at = point << np.uintp(3)
        place = np.uintp(row & (_HASH - 1))
        known = np.uintp(recent[place])
        if (known < np.uintp(min(written[owner], keys.shape[1])) and keys[owner, known, 0] == row
                and keys[owner, known, 1] == tile):
            for value in range(5):
                values[owner, known, value] += slopes[at + np.uintp(value)]
            continue
        count = written[owner]
        written[owner] = count + 1
        if count < keys.shape[1]:
            recent[place] = count
            keys[owner, count, 0], keys[owner, count, 1] = row, tile
            for value in range(5):
                values[owner, count, value] = slopes[at + np.uintp(value)]


@identified("packet slopes of errors")
@lean
def slopes_of_errors(number, tile, size, first, pixels, gain, background, alpha_weight, share, out,
                     grads, grad_background):
    """Slopes of the loss (Eq. 2) by colors and opacity of 16 rays; their squared errors."""
    squared = 0.0
    for i in range(16):
        x = min(tile[2] + (i & 3), size[0] - 1)
        y = min(tile[1] + (i >> 2), size[1] - 1)
        pixel = first + y * size[0] + x
        opacity = np.float32(pixels[pixel, 3]) / np.float32(255.0)
        end = out[48 + i]
        for channel in range(3):
            ground = background[16 * number + i, channel]
            truth = (np.float32(pixels[pixel, channel]) * gain[channel] * opacity
                     + (_one - opacity) * ground)
            error = out[16 * channel + i] + end * ground - truth
            squared += error * error
            slope = np.float32(2.0) * error * share / np.float32(3.0)
            grads[16 * channel + i] = slope
            grads[48 + 16 * channel + i] = end * ground
            grad_background[16 * number + i, channel] = slope * end
        grads[96 + i] = (np.float32(2.0) * alpha_weight * (_one - end - opacity) * share * end)
    return squared
