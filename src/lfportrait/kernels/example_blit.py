"""Hot loops of StyleBlit (Sykora et al. 2019): seeds, chunks from coarse to fine, voting.

Coordinates are continuous: pixel (i, j) of a picture covers [i, i + 1) x [j, j + 1). The target's
pixel p has a guide g(p) (a place in the exemplar), an appearance, and an anchor A(p): its place in
a plane in which the jittered seed grid lies still. For a photo the anchor is the pixel itself; for
a capture it is the unwrapped surface point, so that chunks stick to the surface in every view. A
chunk is a rigid shift D from anchor to exemplar: pixel p shows the exemplar at A(p) + D.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["blit", "elect", "look_up", "seed_points", "seed_regular", "seed_splat", "vote"]

_M1, _M2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_K1, _K2, _K3 = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F),
                 np.uint64(0x165667B19E3779F9))
_S30, _S27, _S31, _S40 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(40)


@numba.njit(cache=True, inline="always")
def _mix(value):
    """Finaliser of splitmix64: an integer hash with full avalanche."""
    value = (value ^ (value >> _S30)) * _M1
    value = (value ^ (value >> _S27)) * _M2
    return value ^ (value >> _S31)


@numba.njit(cache=True)
def _jitter(seed, level, i, j, axis):
    """Uniform number in [0, 1) that depends on the counters alone."""
    key = _mix(np.uint64(seed) * _K1 + np.uint64(level * 2 + axis))
    key = _mix(key ^ (np.uint64(i) * _K2))
    key = _mix(key ^ (np.uint64(j) * _K3))
    return np.float32(np.float64(key >> _S40) / 16777216.0)


@numba.njit(cache=True, parallel=True)
def seed_points(seed, level, first_x, first_y, points):
    """Jittered seeds of the cells (first_x + i, first_y + j), side 2^level, into [Y, X, 2]."""
    side = np.float32(1 << level)
    for j in numba.prange(points.shape[0]):
        for i in range(points.shape[1]):
            x, y = np.int64(first_x + i), np.int64(first_y + j)
            points[j, i, 0] = side * (np.float32(x) + _jitter(seed, level, x, y, 0))
            points[j, i, 1] = side * (np.float32(y) + _jitter(seed, level, x, y, 1))


@numba.njit(cache=True, parallel=True)
def seed_regular(points, scale, height, width, pixels):
    """Pixel under each seed where the anchor is ``scale`` times the pixel; -1 outside."""
    for j in numba.prange(points.shape[0]):
        for i in range(points.shape[1]):
            x = np.int64(np.floor(points[j, i, 0] / scale))
            y = np.int64(np.floor(points[j, i, 1] / scale))
            inside = 0 <= x < width and 0 <= y < height
            pixels[j, i] = y * width + x if inside else -1


@numba.njit(cache=True)
def seed_splat(points, anchor, level, first_x, first_y, best, pixels):
    """Pixel whose anchor is nearest to each seed among those in its cell; -1 for empty cells.

    Serial on purpose: the first pixel in scan order wins among equals.
    """
    side = np.float32(1 << level)
    for y in range(anchor.shape[0]):
        for x in range(anchor.shape[1]):
            ax, ay = anchor[y, x, 0], anchor[y, x, 1]
            if not np.isfinite(ax):
                continue
            i = np.int64(np.floor(ax / side)) - first_x
            j = np.int64(np.floor(ay / side)) - first_y
            dx, dy = ax - points[j, i, 0], ay - points[j, i, 1]
            distance = dx * dx + dy * dy
            if distance < best[j, i]:
                best[j, i] = distance
                pixels[j, i] = y * anchor.shape[1] + x


@numba.njit(cache=True, inline="always")
def _error(gx, gy, a, ox, oy, place, look, weight_position, weight_appearance, weight_label,
           style_appearance, labels, p, style_labels):
    """Guide error between target pixel ``p`` and the exemplar at pixel (oy, ox)."""
    error = (weight_position * (abs(gx - place) + abs(gy - look))
             + weight_appearance * abs(a - style_appearance[oy, ox]))
    difference = np.int64(0)
    for k in range(labels.shape[1]):
        difference += abs(np.int64(labels[p, k]) - np.int64(style_labels[oy, ox, k]))
    return error + weight_label * np.float32(difference)


@numba.njit(cache=True, parallel=True)
def look_up(position, appearance, anchor, weights, labels, weight_label, table, cell, low, step,
            style_appearance, style_labels, gain, snap, shift, error):
    """Every pixel's own look-up: ``shift`` [H, W, 2] (exemplar minus anchor) and its ``error``.

    The table knows the place to a cell; the part of the guide inside the cell is added where that
    does not raise the error, so that smooth guides give smooth shifts. A look-up that improves on
    the guided place itself by less than ``gain`` is not worth a jump.
    """
    height, width = appearance.shape
    levels, rows, columns = table.shape
    style_height, style_width = style_appearance.shape
    for y in numba.prange(height):
        for x in range(width):
            p = y * width + x
            gx, gy, a = position[y, x, 0], position[y, x, 1], appearance[y, x]
            if not np.isfinite(gx):
                shift[y, x, 0] = shift[y, x, 1] = np.float32(np.nan)
                error[y, x] = np.float32(np.inf)
                continue
            i = min(max(np.int64(gx) // cell, 0), columns - 1)
            j = min(max(np.int64(gy) // cell, 0), rows - 1)
            k = min(max(np.int64((a - low) / step + np.float32(0.5)), 0), levels - 1)
            index = table[k, j, i]
            ux, uy = np.int64(index % style_width), np.int64(index // style_width)
            fx, fy = np.float32(ux) + np.float32(0.5), np.float32(uy) + np.float32(0.5)
            e = _error(gx, gy, a, ux, uy, fx, fy, weights[y, x, 0], weights[y, x, 1], weight_label,
                       style_appearance, labels, p, style_labels)
            sx = fx + gx - np.float32((i + 0.5) * cell)
            sy = fy + gy - np.float32((j + 0.5) * cell)
            if 0 <= sx < style_width and 0 <= sy < style_height:
                moved = _error(gx, gy, a, np.int64(sx), np.int64(sy), sx, sy, weights[y, x, 0],
                               weights[y, x, 1], weight_label, style_appearance, labels, p,
                               style_labels)
                if moved <= e:
                    e, fx, fy = moved, sx, sy
            if 0 <= gx < style_width and 0 <= gy < style_height:
                stay = _error(gx, gy, a, np.int64(gx), np.int64(gy), gx, gy, weights[y, x, 0],
                              weights[y, x, 1], weight_label, style_appearance, labels, p,
                              style_labels)
                if stay < e + gain:
                    e, fx, fy = stay, gx, gy
            dx, dy = fx - anchor[y, x, 0], fy - anchor[y, x, 1]
            if snap:
                dx, dy = np.float32(np.rint(dx)), np.float32(np.rint(dy))
            shift[y, x, 0], shift[y, x, 1] = dx, dy
            error[y, x] = e


@numba.njit(cache=True, parallel=True)
def blit(position, appearance, anchor, weights, labels, weight_label, style_appearance,
         style_labels, own_shift, own_error, top, points, pixels, starts, firsts, shapes,
         threshold, slack, shift, level_map):
    """Chunks from coarse to fine: the first shift whose error is small enough is taken.

    ``points`` [N, 2] and ``pixels`` [N] hold the seeds of levels ``top`` .. 1 one after another;
    level l begins at ``starts[l]``, its cells at ``firsts[l]``, ``shapes[l]`` rows and columns.
    A chunk is accepted below max(threshold, own error + slack): where the exemplar has nothing
    alike, coherence is kept instead of scattering pixels. ``level_map`` gets the level, 0 = own.
    """
    height, width = appearance.shape
    style_height, style_width = style_appearance.shape
    for y in numba.prange(height):
        for x in range(width):
            p = y * width + x
            shift[y, x, 0], shift[y, x, 1] = own_shift[y, x, 0], own_shift[y, x, 1]
            level_map[y, x] = 0
            gx, gy, a = position[y, x, 0], position[y, x, 1], appearance[y, x]
            if not np.isfinite(gx):
                continue
            ax, ay = anchor[y, x, 0], anchor[y, x, 1]
            limit = max(threshold, own_error[y, x] + slack)
            for level in range(top, 0, -1):
                side = np.float32(1 << level)
                i = np.int64(np.floor(ax / side)) - firsts[level, 0]
                j = np.int64(np.floor(ay / side)) - firsts[level, 1]
                best, chosen = np.float32(np.inf), np.int64(-1)
                for v in range(max(j - 1, 0), min(j + 2, shapes[level, 0])):
                    for u in range(max(i - 1, 0), min(i + 2, shapes[level, 1])):
                        n = starts[level] + v * shapes[level, 1] + u
                        dx, dy = ax - points[n, 0], ay - points[n, 1]
                        distance = dx * dx + dy * dy
                        if distance < best and pixels[n] >= 0:
                            best, chosen = distance, np.int64(pixels[n])
                if chosen < 0:
                    continue
                qy, qx = chosen // width, chosen % width
                dx, dy = own_shift[qy, qx, 0], own_shift[qy, qx, 1]
                ox, oy = ax + dx, ay + dy
                if not (0 <= ox < style_width and 0 <= oy < style_height):
                    continue
                e = _error(gx, gy, a, np.int64(ox), np.int64(oy), ox, oy, weights[y, x, 0],
                           weights[y, x, 1], weight_label, style_appearance, labels, p,
                           style_labels)
                if e < limit:
                    shift[y, x, 0], shift[y, x, 1] = dx, dy
                    level_map[y, x] = level
                    break


@numba.njit(cache=True, inline="always")
def _sample(picture, x, y, exact):
    """Colour of ``picture`` [H, W, 3] float32 at the continuous place (x, y), clamped inside."""
    height, width = picture.shape[0], picture.shape[1]
    if exact:
        i = min(max(np.int64(np.floor(x)), 0), width - 1)
        j = min(max(np.int64(np.floor(y)), 0), height - 1)
        return picture[j, i, 0], picture[j, i, 1], picture[j, i, 2]
    x = min(max(x - np.float32(0.5), np.float32(0)), np.float32(width - 1))
    y = min(max(y - np.float32(0.5), np.float32(0)), np.float32(height - 1))
    i, j = min(np.int64(x), width - 2), min(np.int64(y), height - 2)
    fx, fy = x - np.float32(i), y - np.float32(j)
    one = np.float32(1)
    a, b, c, d = (one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy
    return (a * picture[j, i, 0] + b * picture[j, i + 1, 0] + c * picture[j + 1, i, 0]
            + d * picture[j + 1, i + 1, 0],
            a * picture[j, i, 1] + b * picture[j, i + 1, 1] + c * picture[j + 1, i, 1]
            + d * picture[j + 1, i + 1, 1],
            a * picture[j, i, 2] + b * picture[j, i + 1, 2] + c * picture[j + 1, i, 2]
            + d * picture[j + 1, i + 1, 2])


@numba.njit(cache=True, parallel=True)
def elect(shift, radius, out):
    """Mode filter: the most frequent shift of each window of side 2 radius + 1, into ``out``.

    The centre's shift stays unless another one has more votes; the first in scan order wins among
    equals.
    """
    height, width = shift.shape[0], shift.shape[1]
    for y in numba.prange(height):
        for x in range(width):
            sx, sy = shift[y, x, 0], shift[y, x, 1]
            out[y, x, 0], out[y, x, 1] = sx, sy
            if not np.isfinite(sx):
                continue
            top, bottom = max(y - radius, 0), min(y + radius + 1, height)
            left, right = max(x - radius, 0), min(x + radius + 1, width)
            most = 0
            for v in range(top, bottom):
                for u in range(left, right):
                    if shift[v, u, 0] == sx and shift[v, u, 1] == sy:
                        most += 1
            if 2 * most >= (bottom - top) * (right - left):
                continue
            for v in range(top, bottom):
                for u in range(left, right):
                    votes = 0
                    for j in range(top, bottom):
                        for i in range(left, right):
                            if (shift[j, i, 0] == shift[v, u, 0]
                                    and shift[j, i, 1] == shift[v, u, 1]):
                                votes += 1
                    if votes > most:
                        most = votes
                        out[y, x, 0], out[y, x, 1] = shift[v, u, 0], shift[v, u, 1]


@numba.njit(cache=True, parallel=True)
def vote(picture, anchor, shift, radius, exact, out):
    """Mean of the colours that the window's shifts vote for, into ``out`` [H, W, 3] float32.

    Pixels without a shift (NaN) stay 0. ``exact`` reads whole pixels, else bilinearly.
    """
    height, width = shift.shape[0], shift.shape[1]
    for y in numba.prange(height):
        for x in range(width):
            ax, ay = anchor[y, x, 0], anchor[y, x, 1]
            sx, sy = shift[y, x, 0], shift[y, x, 1]
            out[y, x, 0] = out[y, x, 1] = out[y, x, 2] = 0
            if not np.isfinite(sx):
                continue
            own_r, own_g, own_b = _sample(picture, ax + sx, ay + sy, exact)
            red, green, blue, count = own_r, own_g, own_b, 1
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    tx, ty = shift[v, u, 0], shift[v, u, 1]
                    if (u == x and v == y) or not np.isfinite(tx):
                        continue
                    if tx == sx and ty == sy:
                        r, g, b = own_r, own_g, own_b
                    else:
                        r, g, b = _sample(picture, ax + tx, ay + ty, exact)
                    red, green, blue, count = red + r, green + g, blue + b, count + 1
            out[y, x, 0] = red / np.float32(count)
            out[y, x, 1] = green / np.float32(count)
            out[y, x, 2] = blue / np.float32(count)
