"""Hot loops that turn chunk shifts into colours: election of shifts, votes, blending.

Shifts lie in two planes [2, rows, columns] with a margin of NaN at least as wide as the window, so
that windows need no bounds. Sixteen pixels of a row are worked on at once; where all of a window
share the middle's shift, as inside a chunk, nothing is left to do.

Colours are packed into one word, ten bits a channel: a place costs one gather instead of three.
"""

from __future__ import annotations

import numba
import numpy as np

from .example_lanes import gather_neighbours, gather_signed, load_pairs, store_triples
from .lanes import LANES
from .lean import lean

__all__ = ["blend", "elect", "pack", "vote"]

_floats, _ints, _where, _iota = LANES.floats, LANES.ints, LANES.where, LANES.iota
_load, _store, _bits, _lane = LANES.load, LANES.store, LANES.bits, LANES.lane
_floor, _absolute = LANES.floor, LANES.absolute
_minimum, _maximum = LANES.minimum, LANES.maximum


@numba.njit(cache=True, nogil=True, parallel=True)
def pack(picture, out):
    """Colours [h, w, 3] float32 in [0, 1] as words [h, w]; exact for multiples of 1 / 255."""
    for y in numba.prange(picture.shape[0]):
        for x in range(picture.shape[1]):
            word = np.int32(0)
            for c in range(3):
                value = min(max(picture[y, x, c], np.float32(0)), np.float32(1))
                word = (word << 10) | np.int32(value * np.float32(1020) + np.float32(0.5))
            out[y, x] = word


@numba.njit(cache=True, inline="always")
def _beside(anchors, n, ax, ay, reach):
    """Whether the anchors of the pixels n .. n + 15 lie near (ax, ay), lane by lane.

    Beyond the picture's ends they are those of other pixels nearby: there are no shifts there.
    """
    n = min(max(n, 0), anchors.size // 2 - 16)
    if n < 0:
        return ax == ax
    bx, by = load_pairs(anchors, 2 * n)
    return _absolute(ax - bx) + _absolute(ay - by) < reach


@lean
def _elect_row(y, anchor, reach, shift, radius, width, out):
    """`elect` of one row."""
    anchors = anchor.reshape(-1)
    stride, plane = shift.shape[2], shift.shape[1] * shift.shape[2]
    values, outs = shift.reshape(-1), out.reshape(-1)
    side = 2 * radius + 1
    zero, one, half = np.float32(0), np.float32(1), np.float32(side * side) / np.float32(2)
    for first in range(0, width, 16):
        corner = y * stride + first
        middle = corner + radius * stride + radius
        x, z = _load(values, middle), _load(values, plane + middle)
        most = _floats(zero)
        for v in range(side):
            for u in range(side):
                n = corner + v * stride + u
                alike = (_load(values, n) == x) & (_load(values, plane + n) == z)
                most += _where(alike, _floats(one), zero)
        own_x, own_z = x, z
        # A majority can't be beaten, and a pixel without a shift gets none.
        if _bits((most < half) & (x == x)) != 0:
            here = y * width + first
            if 2 * here + 32 <= anchors.size:
                ax, ay = load_pairs(anchors, 2 * here)
            else:
                pair = _minimum(_iota() + np.int32(here),
                                np.int32(anchors.size // 2 - 1)) * np.int32(2)
                ax = gather_signed(anchors, pair)
                ay = gather_signed(anchors, pair + np.int32(1))
            for a in range(side * side):
                n = corner + (a // side) * stride + a % side
                other_x, other_z = _load(values, n), _load(values, plane + n)
                votes = _floats(zero)
                for b in range(side * side):
                    m = corner + (b // side) * stride + b % side
                    alike = ((_load(values, m) == other_x)
                             & (_load(values, plane + m) == other_z))
                    votes += _where(alike, _floats(one), zero)
                near = _beside(anchors, here + (a // side - radius) * width
                               + a % side - radius, ax, ay, reach)
                better = (votes > most) & (x == x) & near
                most = _where(better, votes, most)
                own_x, own_z = _where(better, other_x, own_x), _where(better, other_z, own_z)
        _store(outs, middle, own_x)
        _store(outs, plane + middle, own_z)


@numba.njit(cache=True, nogil=True, parallel=True)
def elect(anchor, reach, shift, radius, width, out):
    """Mode filter: the most frequent shift of each window of side 2 radius + 1, into ``out``.

    ``shift`` and ``out`` are planes with a margin of ``radius``, of ``width`` pixels. The centre's
    shift stays unless another one has more votes; the first in scan order wins among equals. A
    shift of a pixel whose anchor is not within ``reach`` (L1) is no candidate: it belongs to
    another piece of the anchor plane.
    """
    for y in numba.prange(shift.shape[1] - 2 * radius):
        _elect_row(y, anchor, reach, shift, radius, width, out)


@numba.njit(cache=True, inline="always")
def _channels(word):
    """Red, green and blue of packed colours, lane by lane, 0 to 1020."""
    ten, bits = np.int32(10), np.int32(1023)
    return (_floats((word >> np.int32(20)) & bits), _floats((word >> ten) & bits),
            _floats(word & bits))


@numba.njit(cache=True, inline="always")
def _sample(colours, height, width, x, y, exact):
    """Colour of the packed picture at the continuous places (x, y), clamped inside, 0 to 1020."""
    zero, half = np.float32(0), np.float32(0.5)
    right, bottom = np.float32(width - 1), np.float32(height - 1)
    pitch = np.int32(width)
    if exact:
        i = _ints(_minimum(_maximum(_floor(x), zero), right))
        j = _ints(_minimum(_maximum(_floor(y), zero), bottom))
        return _channels(gather_signed(colours, j * pitch + i))
    x, y = _minimum(_maximum(x - half, zero), right), _minimum(_maximum(y - half, zero), bottom)
    i, j = _minimum(_ints(x), np.int32(width - 2)), _minimum(_ints(y), np.int32(height - 2))
    fx, fy = x - _floats(i), y - _floats(j)
    n = j * pitch + i
    left, right_one = gather_neighbours(colours, n)
    ar, ag, ab = _channels(left)
    br, bg, bb = _channels(right_one)
    left, right_one = gather_neighbours(colours, n + pitch)
    cr, cg, cb = _channels(left)
    dr, dg, db = _channels(right_one)
    ar, ag, ab = ar + fx * (br - ar), ag + fx * (bg - ag), ab + fx * (bb - ab)
    cr, cg, cb = cr + fx * (dr - cr), cg + fx * (dg - cg), cb + fx * (db - cb)
    return ar + fy * (cr - ar), ag + fy * (cg - ag), ab + fy * (cb - ab)


@lean
def _vote_row(y, colours, anchor, reach, shift, margin, radius, exact, out):
    """`vote` of one row."""
    height, width = out.shape[:2]
    style_height, style_width = colours.shape
    stride, plane = shift.shape[2], shift.shape[1] * shift.shape[2]
    values, anchors, flat = shift.reshape(-1), anchor.reshape(-1), colours.reshape(-1)
    flat_out = out.reshape(-1)
    zero, one = np.float32(0), np.float32(1)
    for first in range(0, width, 16):
        middle = (y + margin) * stride + margin + first
        x, z = _load(values, middle), _load(values, plane + middle)
        known = x == x
        if _bits(known) == 0:
            for n in range(min(16, width - first)):
                out[y, first + n, 0] = out[y, first + n, 1] = out[y, first + n, 2] = zero
            continue
        here = y * width + first
        if 2 * here + 32 <= anchors.size:
            ax, ay = load_pairs(anchors, 2 * here)
        else:
            pair = (_minimum(_iota() + np.int32(first), np.int32(width - 1))
                    + np.int32(y * width)) * np.int32(2)
            ax, ay = gather_signed(anchors, pair), gather_signed(anchors, pair + np.int32(1))
        ax, ay = _where(known, ax, zero), _where(known, ay, zero)
        red, green, blue = _sample(flat, style_height, style_width, ax + _where(known, x, zero),
                                   ay + _where(known, z, zero), exact)
        count = _floats(one)
        if radius > 0:
            # Neighbours mostly share a shift with the middle or with the one looked at before.
            own_votes = _floats(one)
            last_x, last_z, last_red, last_green, last_blue = x, z, red, green, blue
            other_red, other_green, other_blue = _floats(zero), _floats(zero), _floats(zero)
            for u in range(-radius, radius + 1):
                for v in range(-radius, radius + 1):
                    if u == 0 and v == 0:
                        continue
                    n = middle + v * stride + u
                    tx, tz = _load(values, n), _load(values, plane + n)
                    own = (tx == x) & (tz == z)
                    own_votes += _where(own, _floats(one), zero)
                    others = (tx == tx) & known & ~own
                    if _bits(others) == 0:
                        continue
                    others = others & _beside(anchors, here + v * width + u, ax, ay, reach)
                    if _bits(others & ~((tx == last_x) & (tz == last_z))) != 0:
                        last_x, last_z = tx, tz
                        last_red, last_green, last_blue = _sample(
                            flat, style_height, style_width, ax + _where(tx == tx, tx, zero),
                            ay + _where(tx == tx, tz, zero), exact)
                    other_red += _where(others, last_red, zero)
                    other_green += _where(others, last_green, zero)
                    other_blue += _where(others, last_blue, zero)
                    count += _where(others, _floats(one), zero)
            red = red * own_votes + other_red
            green = green * own_votes + other_green
            blue = blue * own_votes + other_blue
            count += own_votes - one
        share = _where(known, np.float32(1 / 1020) / count, zero)
        red, green, blue = red * share, green * share, blue * share
        if first + 16 <= width:
            store_triples(flat_out, 3 * here, red, green, blue)
        else:
            for n in range(width - first):
                out[y, first + n, 0] = _lane(red, n)
                out[y, first + n, 1] = _lane(green, n)
                out[y, first + n, 2] = _lane(blue, n)


@numba.njit(cache=True, nogil=True, parallel=True)
def vote(colours, anchor, reach, shift, margin, radius, exact, out):
    """Mean of the colours that the window's shifts vote for, into ``out`` [H, W, 3] float32.

    ``shift`` are planes with a ``margin`` of at least ``radius``; ``colours`` int32 [h, w] packed.
    Pixels without a shift (NaN) stay 0. ``exact`` reads whole pixels, else bilinearly. Pixels whose
    anchor is not within ``reach`` (L1) have no vote: their shifts mean other places here.
    """
    for y in numba.prange(out.shape[0]):
        _vote_row(y, colours, anchor, reach, shift, margin, radius, exact, out)


@numba.njit(cache=True, nogil=True, parallel=True)
def blend(photo, scale, painted, cover, out):
    """``photo`` times ``scale``, covered by ``painted`` where ``cover`` [H, W] is 1; float32."""
    height, width = cover.shape
    for y in numba.prange(height):
        for x in range(width):
            share = cover[y, x]
            for c in range(3):
                base = np.float32(photo[y, x, c]) * scale
                out[y, x, c] = base + share * (painted[y, x, c] - base)
