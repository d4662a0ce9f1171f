"""Hot loops of StyleBlit (Sykora et al. 2019): look-ups, and chunks from coarse to fine.

Coordinates are continuous: pixel (i, j) of a picture covers [i, i + 1) x [j, j + 1). The target's
pixel p has a guide g(p) (a place in the exemplar), an appearance, and an anchor A(p): its place in
a plane in which the jittered seed grid lies still. For a photo the anchor is the pixel itself; for
a capture it is the unwrapped surface point, so that chunks stick to the surface in every view. A
chunk is a rigid shift D from anchor to exemplar: pixel p shows the exemplar at A(p) + D.

The guide error has three parts, none negative: place, appearance, labels. The labels of a pixel are
eight bytes in one word; they are compared only where the first two parts have not decided.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["blit", "look_up"]

_BYTE = np.uint64(255)


@numba.njit(cache=True, inline="always")
def _label_difference(one, two):
    """Sum of the differences of the eight bytes of two words."""
    total = np.int64(0)
    if one != two:
        for k in range(8):
            shift = np.uint64(8 * k)
            total += abs(np.int64((one >> shift) & _BYTE) - np.int64((two >> shift) & _BYTE))
    return np.float32(total)


@numba.njit(cache=True, inline="always")
def _error(gx, gy, a, x, y, place, look, weight_label, word, style_appearance, style_words):
    """Guide error between a target pixel and the exemplar at the continuous place (x, y)."""
    ox, oy = np.uintp(x), np.uintp(y)
    return (place * (abs(gx - x) + abs(gy - y)) + look * abs(a - style_appearance[oy, ox])
            + weight_label * _label_difference(word, style_words[oy, ox]))


@numba.njit(cache=True, parallel=True)
def look_up(position, appearance, anchor, weights, words, weight_label, table, cell, low, step,
            style_appearance, style_words, gain, snap, shift, error):
    """Every pixel's own look-up: ``shift`` [H, W, 2] (exemplar minus anchor) and its ``error``.

    The table knows the place to a cell; the part of the guide inside the cell is added where that
    does not raise the error, so that smooth guides give smooth shifts. A look-up that improves on
    the guided place itself by less than ``gain`` is not worth a jump.
    """
    height, width = appearance.shape
    rows, columns, levels = table.shape
    style_height, style_width = style_appearance.shape
    zero, share = np.float32(0), np.float32(1) / step
    for y in numba.prange(height):
        for x in range(width):
            gx, gy, a = position[y, x, 0], position[y, x, 1], appearance[y, x]
            if not np.isfinite(gx):
                shift[y, x, 0] = shift[y, x, 1] = np.float32(np.nan)
                error[y, x] = np.float32(np.inf)
                continue
            place, look, word = weights[y, x, 0], weights[y, x, 1], words[y, x]
            fx, fy, e = gx, gy, np.float32(np.inf)
            if 0 <= gx < style_width and 0 <= gy < style_height:
                e = _error(gx, gy, a, gx, gy, place, look, weight_label, word, style_appearance,
                           style_words)
            # No look-up can beat an error below the gain.
            if e >= gain:
                i = min(max(np.int64(gx) // cell, 0), columns - 1)
                j = min(max(np.int64(gy) // cell, 0), rows - 1)
                k = min(max(np.int64((a - low) * share + np.float32(0.5)), 0), levels - 1)
                index = np.int64(table[np.uintp(j), np.uintp(i), np.uintp(k)])
                v = index // style_width
                ux = np.float32(index - v * style_width) + np.float32(0.5)
                uy = np.float32(v) + np.float32(0.5)
                found = _error(gx, gy, a, ux, uy, place, look, weight_label, word,
                               style_appearance, style_words)
                sx = ux + gx - np.float32((i + 0.5) * cell)
                sy = uy + gy - np.float32((j + 0.5) * cell)
                if 0 <= sx < style_width and 0 <= sy < style_height:
                    moved = _error(gx, gy, a, sx, sy, place, look, weight_label, word,
                                   style_appearance, style_words)
                    if moved <= found:
                        found, ux, uy = moved, sx, sy
                if e >= found + gain:
                    fx, fy, e = ux, uy, found
            dx, dy = fx - anchor[y, x, 0], fy - anchor[y, x, 1]
            if snap:
                dx, dy = np.float32(np.rint(dx)), np.float32(np.rint(dy))
            # Shifts are compared by their bits: there must be no negative zero.
            shift[y, x, 0], shift[y, x, 1] = dx + zero, dy + zero
            error[y, x] = e


@numba.njit(cache=True, inline="always")
def _nearest_seed(ax, ay, share, first_x, first_y, start, columns, points):
    """Flat number of the seed nearest to (ax, ay) among those of the 3 x 3 cells about it."""
    i = np.int64(np.floor(ax * share)) - first_x
    j = np.int64(np.floor(ay * share)) - first_y
    corner = start + (j - 1) * columns + i - 1
    best, nearest = np.float32(np.inf), np.uintp(corner)
    for v in range(3):
        for u in range(3):
            n = np.uintp(corner + v * columns + u)
            dx, dy = ax - points[n, 0], ay - points[n, 1]
            distance = dx * dx + dy * dy
            nearest = n if distance < best else nearest
            best = min(distance, best)
    return nearest


@numba.njit(cache=True, parallel=True)
def blit(position, appearance, anchor, weights, words, weight_label, style_appearance, style_words,
         own_shift, own_error, top, points, pixels, starts, firsts, shapes, threshold, slack, shift,
         level_map):
    """Chunks from coarse to fine: the first shift whose error is small enough is taken.

    ``points`` [N, 2] and ``pixels`` [N] hold the seeds of levels ``top`` .. 1 one after another;
    level l begins at ``starts[l]``, its cells at ``firsts[l]``, ``shapes[l]`` rows and columns.
    A chunk is accepted below max(threshold, own error + slack): where the exemplar has nothing
    alike, coherence is kept instead of scattering pixels. ``level_map`` gets the level, 0 = own.
    """
    height, width = appearance.shape
    style_height, style_width = style_appearance.shape
    flat_shift = own_shift.reshape(height * width, 2)
    for y in numba.prange(height):
        for x in range(width):
            shift[y, x, 0], shift[y, x, 1] = own_shift[y, x, 0], own_shift[y, x, 1]
            level_map[y, x] = 0
            gx, gy, a = position[y, x, 0], position[y, x, 1], appearance[y, x]
            if not np.isfinite(gx):
                continue
            ax, ay = anchor[y, x, 0], anchor[y, x, 1]
            place, look, word = weights[y, x, 0], weights[y, x, 1], words[y, x]
            limit = max(threshold, own_error[y, x] + slack)
            for level in range(top, 0, -1):
                share = np.float32(1) / np.float32(1 << level)
                nearest = _nearest_seed(ax, ay, share, firsts[level, 0], firsts[level, 1],
                                        starts[level], shapes[level, 1], points)
                chosen = np.int64(pixels[nearest])
                if chosen < 0:
                    continue
                dx, dy = flat_shift[np.uintp(chosen), 0], flat_shift[np.uintp(chosen), 1]
                sx, sy = ax + dx, ay + dy
                if not (0 <= sx < style_width and 0 <= sy < style_height):
                    continue
                ox, oy = np.uintp(sx), np.uintp(sy)
                e = (place * (abs(gx - sx) + abs(gy - sy))
                     + look * abs(a - style_appearance[oy, ox]))
                if e >= limit:
                    continue
                e += weight_label * _label_difference(word, style_words[oy, ox])
                if e < limit:
                    shift[y, x, 0], shift[y, x, 1] = dx, dy
                    level_map[y, x] = level
                    break
