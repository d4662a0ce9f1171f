"""Hot loops of StyleBlit (Sykora et al. 2019): each pixel's look-up, and its chunks.

Coordinates are continuous: pixel (i, j) of a picture covers [i, i + 1) x [j, j + 1). The target's
pixel p has a guide g(p) (a place in the exemplar), an appearance, and an anchor A(p): its place in
a plane in which the jittered seed grid lies still. For a photo the anchor is the pixel itself; for
a capture it is the unwrapped surface point, so that chunks stick to the surface in every view. A
chunk is a rigid shift D from anchor to exemplar: pixel p shows the exemplar at A(p) + D.

The guide error has three parts, none negative: place, appearance, labels. The labels of a pixel are
eight bytes in two words; they are compared only where the first two parts have not decided.

Sixteen pixels of a row are worked on at once. Shifts lie in two planes [2, rows, columns] with a
margin of NaN, wide enough for the voting window and for whole vectors (`vote`).
"""

import numba
import numpy as np

from ...simd.decorators import lean_kernel, woven
from ...simd.interleaved import gather_pairs, gather_signed, pairs, prefetch, singles, store_bytes
from ...simd.threads import share_out, shared
from ...simd.vectors import LANES, round_even
from .seeds import seed_correction

AHEAD = 48  # Pixels that the reading of exemplar and table is asked for in advance.
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


TILE = 8  # Rows of a tile: its 16 x 8 pixels share the search for seeds that may be near.
_MOST_CELLS, _MOST_SEEDS, _SEEDS_OF_TILE = 300, 96, 128


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


@numba.njit(cache=True, inline="always")
def _place(pixel, width, margin, stride):
    """Place of a pixel's shift in the flat planes."""
    row = pixel // width
    return np.uintp((row + margin) * stride + margin + pixel - row * width)


@numba.njit(cache=True, inline="always")
def _ask_rows(style_looks, style_words, width, height, box, rows, seed):
    """Ask for what a chunk with the shift of ``seed`` shows in ``rows`` rows of a tile."""
    left, right = box[0] + seed[2], box[2] + seed[2]
    step = (box[3] - box[1]) / np.float32(TILE)
    for row in range(TILE - rows, TILE):
        y = box[1] + (np.float32(row) + np.float32(0.5)) * step + seed[3]
        ask(style_looks, style_words, width, height, left, y)
        ask(style_looks, style_words, width, height, np.float32(0.5) * (left + right), y)
        ask(style_looks, style_words, width, height, right, y)


@numba.njit(cache=True, inline="always")
def _near_seeds(box, share, first_x, first_y, start, columns, points, pixels, near):
    """Flat numbers of the seeds that may be nearest to a place in ``box``; how many, or -1.

    ``box`` is (left, top, right, bottom) in the anchor plane. A seed that is further from all of
    the box than another one from its farthest corner is nowhere the nearest. -1: there are too
    many, the box is torn.
    """
    left = np.int64(np.floor(box[0] * share)) - first_x - 1
    top = np.int64(np.floor(box[1] * share)) - first_y - 1
    right = np.int64(np.floor(box[2] * share)) - first_x + 1
    bottom = np.int64(np.floor(box[3] * share)) - first_y + 1
    if (right - left + 1) * (bottom - top + 1) > _MOST_CELLS:
        return -1
    bound = np.float32(np.inf)
    for j in range(top, bottom + 1):
        for i in range(left, right + 1):
            n = np.uintp(start + j * columns + i)
            x, y = points[n, 0], points[n, 1]
            dx, dy = max(x - box[0], box[2] - x), max(y - box[1], box[3] - y)
            bound = min(bound, dx * dx + dy * dy)
    count = 0
    for j in range(top, bottom + 1):
        for i in range(left, right + 1):
            n = np.uintp(start + j * columns + i)
            x, y = points[n, 0], points[n, 1]
            dx = max(max(box[0] - x, x - box[2]), np.float32(0))
            dy = max(max(box[1] - y, y - box[3]), np.float32(0))
            if pixels[n] >= 0 and dx * dx + dy * dy <= bound:
                if count == _MOST_SEEDS:
                    return -1
                near[count] = n
                count += 1
    return count


@numba.njit(cache=True, inline="always")
def _box(anchors, width, top, bottom, first, low_x, low_y, box):
    """Bounds of the anchors of a tile into ``box``; (inf, .., -inf, ..) where none is known."""
    least_x, least_y = _floats(np.float32(np.inf)), _floats(np.float32(np.inf))
    most_x, most_y = _floats(np.float32(-np.inf)), _floats(np.float32(-np.inf))
    for y in range(top, bottom):
        ax, ay = pairs(anchors, y * width + first)
        least_x, least_y = _minimum(least_x, ax), _minimum(least_y, ay)
        most_x, most_y = _maximum(most_x, ax), _maximum(most_y, ay)
    box[0] = box[1] = np.float32(np.inf)
    box[2] = box[3] = np.float32(-np.inf)
    _store(low_x, 0, least_x)
    _store(low_y, 0, least_y)
    for n in range(16):
        box[0], box[1] = min(box[0], low_x[n]), min(box[1], low_y[n])
    _store(low_x, 0, most_x)
    _store(low_y, 0, most_y)
    for n in range(16):
        box[2], box[3] = max(box[2], low_x[n]), max(box[3], low_y[n])


@lean_kernel
def _blit_bands(first_band, last_band, position, appearance, anchor, weights, words, weight_label,
                style_appearance, style_words, own_shift, own_error, top, usual, calm, finest,
                points, pixels, starts, firsts, shapes, threshold, slack, free, margin, near,
                seeds, begins, counts, boxes, buffers, shift, level_map):
    """`blit` of some rows of tiles.

    ``seeds`` gets the seeds near a band's tiles, one after the other: places and shifts.
    ``begins`` and ``counts`` [tiles, levels] say which ones belong to a level of a tile: the first
    and how many, -1 too many, -2 not looked for yet. ``near``, ``boxes`` and ``buffers`` are used
    on the way.
    """
    height, width = appearance.shape
    style_height, style_width = style_appearance.shape
    places, looks, anchors, heavy, flat_words, style_looks, style_flat = flattened(
        position, appearance, anchor, weights, words, style_appearance, style_words)
    errors, flat_own, flat_shift = own_error.reshape(-1), own_shift.reshape(-1), shift.reshape(-1)
    stride, plane = shift.shape[2], shift.shape[1] * shift.shape[2]
    wide, high = np.float32(style_width), np.float32(style_height)
    zero, infinite, unknown = np.float32(0), np.float32(np.inf), np.float32(np.nan)
    tiles, stored = boxes.shape[0], 0
    buffer, buffer_y, flat_levels = buffers[0], buffers[1], level_map.reshape(-1)
    # Row by row, not tile by tile: so chunks read the exemplar in a stream.
    for y in range(first_band * TILE, min(last_band * TILE, height)):
        lower = min(y - y % TILE + TILE, height)
        if y % TILE == 0:
            stored = 0
            for tile in range(tiles):
                _box(anchors, width, y, lower, 16 * tile, buffer, buffer_y, boxes[tile])
                for level in range(top + 1):
                    counts[tile, level] = -2
        for tile in range(tiles):
            first = 16 * tile
            n = y * width + first
            start = (y + margin) * stride + margin + first
            dx, dy = _load(flat_own, start), _load(flat_own, plane + start)
            chosen = _ints(np.int32(0))
            gx, gy = pairs(places, n)
            todo = gx == gx
            if _bits(todo) != 0:
                ax, ay = pairs(anchors, n)
                a = singles(looks, n)
                place, look = pairs(heavy, n)
                low, high_word = pairs(flat_words, n)
                limit = _maximum(singles(errors, n) + slack, threshold)
                box = boxes[tile]
                for level in range(top, finest - 1, -1):
                    if _bits(todo) == 0:
                        break
                    ready = todo if level <= usual else todo & (look < calm)
                    if _bits(ready) == 0:
                        continue
                    share = np.float32(1) / np.float32(1 << level)
                    if counts[tile, level] == -2:
                        count = _near_seeds(box, share, firsts[level, 0], firsts[level, 1],
                                            starts[level], shapes[level, 1], points, pixels,
                                            near)
                        if stored + count > seeds.shape[0]:
                            count = -1
                        begins[tile, level], counts[tile, level] = stored, count
                        for c in range(count):
                            seed = near[c]
                            at = _place(np.int64(pixels[seed]), width, margin, stride)
                            seeds[stored, 0] = points[seed, 0]
                            seeds[stored, 1] = points[seed, 1]
                            seeds[stored, 2] = flat_own[at]
                            seeds[stored, 3] = flat_own[np.uintp(plane) + at]
                            if free:
                                more_x, more_y = seed_correction(
                                    places, anchors, np.int64(pixels[seed]), width,
                                    points[seed, 0], points[seed, 1])
                                seeds[stored, 2] += more_x
                                seeds[stored, 3] += more_y
                            if level >= 4:
                                _ask_rows(style_looks, style_flat, style_width, style_height,
                                          box, lower - y, seeds[stored])
                            stored += 1
                    kx, ky = _floats(unknown), _floats(unknown)
                    if counts[tile, level] >= 0:
                        nearest = _floats(infinite)
                        begin = begins[tile, level]
                        for c in range(begin, begin + counts[tile, level]):
                            ox, oy = ax - seeds[c, 0], ay - seeds[c, 1]
                            distance = ox * ox + oy * oy
                            closer = distance < nearest
                            nearest = _where(closer, distance, nearest)
                            kx = _where(closer, seeds[c, 2], kx)
                            ky = _where(closer, seeds[c, 3], ky)
                    else:
                        _store(buffer, 0, ax)
                        _store(buffer_y, 0, ay)
                        for k in range(16):
                            x, z = buffer[k], buffer_y[k]
                            buffer[k] = buffer_y[k] = unknown
                            if np.isfinite(x):
                                seed = _nearest_seed(
                                    x, z, share, firsts[level, 0], firsts[level, 1],
                                    starts[level], shapes[level, 1], points)
                                if pixels[seed] >= 0:
                                    at = _place(np.int64(pixels[seed]), width, margin, stride)
                                    buffer[k] = flat_own[at]
                                    buffer_y[k] = flat_own[np.uintp(plane) + at]
                                    if free:
                                        more_x, more_y = seed_correction(
                                            places, anchors, np.int64(pixels[seed]), width,
                                            points[seed, 0], points[seed, 1])
                                        buffer[k] += more_x
                                        buffer_y[k] += more_y
                        kx, ky = _load(buffer, 0), _load(buffer_y, 0)
                    sx, sy = ax + kx, ay + ky
                    good = (ready & (sx >= zero) & (sx < wide) & (sy >= zero) & (sy < high))
                    other = _where(good, _ints(sy) * np.int32(style_width) + _ints(sx), np.int32(0))
                    e = (place * (_absolute(gx - sx) + _absolute(gy - sy))
                         + look * _absolute(a - gather_signed(style_looks, other)))
                    good = good & (e < limit)
                    if _bits(good) != 0:
                        e = e + weight_label * label_difference(low, high_word, style_flat, other)
                        good = good & (e < limit)
                        dx, dy = _where(good, kx, dx), _where(good, ky, dy)
                        chosen = _where(good, np.int32(level), chosen)
                        todo = todo & ~good
            _store(flat_shift, start, dx)
            _store(flat_shift, plane + start, dy)
            if first + 16 <= width:
                store_bytes(flat_levels, n, chosen)
            else:
                for k in range(width - first):
                    flat_levels[n + k] = np.uint8(_lane(chosen, k))
                for k in range(width - first, 16):
                    flat_shift[start + k] = flat_shift[plane + start + k] = unknown


def blit(position, appearance, anchor, weights, words, weight_label, style_appearance, style_words,
         own_shift, own_error, top, usual, calm, finest, points, pixels, starts, firsts, shapes,
         threshold, slack, free, margin, shift, level_map):
    """Chunks from coarse to fine: the first shift whose error is small enough is taken.

    ``points`` [N, 2] and ``pixels`` [N] hold the seeds of levels ``finest`` .. ``top``;
    level l begins at ``starts[l]``, its cells at ``firsts[l]``, ``shapes[l]`` rows and columns.
    A chunk is accepted below max(threshold, own error + slack): where the exemplar has nothing
    alike, coherence is kept instead of scattering pixels. Levels above ``usual`` serve only pixels
    whose appearance weighs less than ``calm``. ``free`` anchors are those of surfaces: shifts are
    taken at the seed itself, not at the pixel next to it. ``level_map`` gets the level, 0 = own.
    """
    height, width = appearance.shape
    tiles = (width + 15) // 16

    def bands(first, last):
        near = np.empty(_MOST_SEEDS, np.uintp)
        seeds = np.empty((tiles * _SEEDS_OF_TILE, 4), np.float32)
        begins, counts = np.empty((2, tiles, top + 1), np.int64)
        boxes, buffers = np.empty((tiles, 4), np.float32), np.empty((2, 16), np.float32)
        _blit_bands(first, last, position, appearance, anchor, weights, words, weight_label,
                    style_appearance, style_words, own_shift, own_error, top, usual, calm, finest,
                    points, pixels, starts, firsts, shapes, threshold, slack, free, margin, near,
                    seeds, begins, counts, boxes, buffers, shift, level_map)

    share_out(bands, (height + TILE - 1) // TILE)
