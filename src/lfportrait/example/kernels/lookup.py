"""The look-up of each pixel, shared with the chunk kernel (`blit`).

The target's pixel p has a guide g(p) (a place in the exemplar), an appearance and labels; the guide
error has three parts, none negative: place, appearance, labels. The labels of a pixel are eight
bytes in two words. Sixteen pixels of a row are worked on at once.
"""

from __future__ import annotations

import numba
import numpy as np

from ...simd.decorators import lean_kernel, woven
from ...simd.interleaved import gather_pairs, gather_signed, pairs, prefetch, singles
from ...simd.threads import shared
from ...simd.vectors import LANES, round_even

__all__ = ["ask", "flattened", "label_difference", "look_up"]

AHEAD = 48
"""Pixels that the reading of exemplar and table is asked for in advance."""
_floats, _ints, _where = LANES.floats, LANES.ints, LANES.where
_load, _store, _bits = LANES.load, LANES.store, LANES.bits
_floor, _absolute, _lane = LANES.floor, LANES.absolute, LANES.lane
_minimum, _maximum = LANES.minimum, LANES.maximum


@numba.njit(cache=True, inline="always")
def _word_difference(one, two):
    """Sum of the differences of the four bytes of two words, lane by lane."""
    byte = np.int32(255)
    total = _ints(np.int32(0))
    for k in range(4):
        shift = np.int32(8 * k)
        a, b = (one >> shift) & byte, (two >> shift) & byte
        total += _maximum(a, b) - _minimum(a, b)
    return total


@woven
def label_difference(low, high, style_words, other):
    """Sum of the differences of the eight labels of pixels of target and exemplar."""
    style_low, style_high = gather_pairs(style_words, other)
    return _floats(_word_difference(low, style_low) + _word_difference(high, style_high))


@numba.njit(cache=True, inline="always")
def flattened(position, appearance, anchor, weights, words, style_appearance, style_words):
    """Guides of target and exemplar as flat arrays, in the same order."""
    return (position.reshape(-1), appearance.reshape(-1), anchor.reshape(-1), weights.reshape(-1),
            words.reshape(-1), style_appearance.reshape(-1), style_words.reshape(-1))


@numba.njit(cache=True, inline="always")
def _error(gx, gy, a, x, y, inside, place, look, weight_label, low, high, style_width,
           style_appearance, style_words):
    """Guide error between target pixels and the exemplar at the places (x, y), where ``inside``."""
    other = _where(inside, _ints(y) * style_width + _ints(x), np.int32(0))
    return (place * (_absolute(gx - x) + _absolute(gy - y))
            + look * _absolute(a - gather_signed(style_appearance, other))
            + weight_label * label_difference(low, high, style_words, other))


@woven
def ask(style_looks, style_words, width, height, x, y):
    """Ask for the exemplar's pixel at the place (x, y), if it lies inside."""
    if 0 <= x < width and 0 <= y < height:
        n = np.int64(y) * width + np.int64(x)
        prefetch(style_looks, n)
        prefetch(style_words, 2 * n)


@shared("appearance")
@lean_kernel
def look_up(since, until, position, appearance, anchor, weights, words, weight_label, table, cell,
            low, step, style_appearance, style_words, gain, snap, margin, shift, error):
    """Every pixel's own look-up: ``shift`` (exemplar minus anchor, planes) and its ``error``.

    The table knows the place to a cell; the part of the guide inside the cell is added where that
    does not raise the error, so that smooth guides give smooth shifts. A look-up that improves on
    the guided place itself by less than ``gain`` is not worth a jump.
    """
    width = appearance.shape[1]
    rows, columns, levels = table.shape
    style_height, style_width = style_appearance.shape
    places, looks, anchors, heavy, flat_words, style_looks, style_flat = flattened(
        position, appearance, anchor, weights, words, style_appearance, style_words)
    entries, flat_shift, errors = table.reshape(-1), shift.reshape(-1), error.reshape(-1)
    stride, plane = shift.shape[2], shift.shape[1] * shift.shape[2]
    wide, high = np.float32(style_width), np.float32(style_height)
    whole, pitch = np.int32(style_width), np.int32(columns)
    zero, half, share = np.float32(0), np.float32(0.5), np.float32(1) / step
    side = np.float32(cell)
    slim = np.float32(1 / cell)
    unknown, infinite = np.float32(np.nan), np.float32(np.inf)
    one = np.int32(1)
    jumps = False
    across = (width + 15) // 16
    for vector in range(since * across, until * across):
        y, first = vector // across, vector % across * 16
        n = y * width + first
        gx, gy = pairs(places, n)
        known = gx == gx
        dx, dy, e = _floats(unknown), _floats(unknown), _floats(infinite)
        # What the next vectors read of exemplar and table is far from what these read.
        for k in range(n + AHEAD, min(n + AHEAD + 16, looks.size)):
            x, z = places[2 * k], places[2 * k + 1]
            if not (0 <= x < wide and 0 <= z < high):
                continue
            if k & 7 == 0 or k & 15 == 15:
                ask(style_looks, style_flat, style_width, style_height, x, z)
            if jumps:
                q = min(max((looks[k] - low) * share + half, zero), np.float32(levels - 1))
                prefetch(entries, (np.int64(z * slim) * columns + np.int64(x * slim)) * levels
                         + np.int64(q))
        jumps = False
        if _bits(known) != 0:
            a = singles(looks, n)
            place, look = pairs(heavy, n)
            one_word, other_word = pairs(flat_words, n)
            inside = (gx >= zero) & (gx < wide) & (gy >= zero) & (gy < high)
            fx, fy = gx, gy
            found = _error(gx, gy, a, gx, gy, inside, place, look, weight_label,
                           one_word, other_word, whole, style_looks, style_flat)
            e = _where(inside, found, infinite)
            # No look-up can beat an error below the gain.
            if _bits(known & (e >= gain)) != 0:
                jumps = True
                i = (_floor(_minimum(_maximum(gx, zero), wide)) + half) / side
                j = (_floor(_minimum(_maximum(gy, zero), high)) + half) / side
                i = _minimum(_ints(_where(known, i, zero)), np.int32(columns - 1))
                j = _minimum(_ints(_where(known, j, zero)), np.int32(rows - 1))
                k = _minimum(_maximum((a - low) * share + half, zero), np.float32(levels - 1))
                entry = gather_signed(entries, (j * pitch + i) * np.int32(levels) + _ints(k))
                v = _ints((_floats(entry) + half) / wide)
                rest = entry - v * whole
                # Beyond 2^24 pixels a float does not hold the entry.
                v = _where(rest < np.int32(0), v - one, _where(rest >= whole, v + one, v))
                ux, uy = _floats(entry - v * whole) + half, _floats(v) + half
                sx = ux + gx - (_floats(i) + half) * side
                sy = uy + gy - (_floats(j) + half) * side
                # Most are too far away whatever they look like.
                near = place * _minimum(_absolute(gx - ux) + _absolute(gy - uy),
                                        _absolute(gx - sx) + _absolute(gy - sy))
                if _bits(known & (e >= near + gain)) != 0:
                    found = _error(gx, gy, a, ux, uy, known, place, look, weight_label,
                                   one_word, other_word, whole, style_looks, style_flat)
                    inside = (sx >= zero) & (sx < wide) & (sy >= zero) & (sy < high)
                    moved = _error(gx, gy, a, sx, sy, inside, place, look, weight_label,
                                   one_word, other_word, whole, style_looks, style_flat)
                    better = inside & (moved <= found)
                    found = _where(better, moved, found)
                    ux, uy = _where(better, sx, ux), _where(better, sy, uy)
                    better = e >= found + gain
                    fx, fy, e = _where(better, ux, fx), _where(better, uy, fy), _where(
                        better, found, e)
            ax, ay = pairs(anchors, n)
            dx, dy = fx - ax, fy - ay
            if snap:
                dx, dy = round_even(dx), round_even(dy)
            dx = _where(known, dx, unknown)
            e = _where(known, e, infinite)
        start = (y + margin) * stride + margin + first
        _store(flat_shift, start, dx)
        _store(flat_shift, plane + start, dy)
        if first + 16 <= width:
            _store(errors, n, e)
        else:
            for k in range(width - first):
                errors[n + k] = _lane(e, k)
            # Whole vectors reached into the margin.
            for k in range(width - first, 16):
                flat_shift[start + k] = flat_shift[plane + start + k] = unknown
