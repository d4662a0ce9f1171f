"""Hot loops that turn chunk shifts into colors: election of shifts, votes, blending.

Shifts lie in two planes [2, rows, columns] with a margin of NaN at least as wide as the window, so
that windows need no bounds. Sixteen pixels of a row are worked on at once; where all of a window
share the middle's shift, as inside a chunk, nothing is left to do.

Colors are packed into one word, ten bits a channel: a place costs one gather instead of three.
"""

import numba
import numpy as np

from ...simd.decorators import lean_kernel, woven
from ...simd.interleaved import gather_neighbours, gather_signed, load_pairs, pairs, store_triples
from ...simd.threads import share_out, shared
from ...simd.vectors import LANES

_floats, _ints, _where = LANES.floats, LANES.ints, LANES.where
_load, _store, _bits, _lane = LANES.load, LANES.store, LANES.bits, LANES.lane
_floor, _absolute = LANES.floor, LANES.absolute
_minimum, _maximum, _iota = LANES.minimum, LANES.maximum, LANES.iota


@shared("picture")
@lean_kernel
def pack(since, until, picture, out):
    """Colors [h, w, 3] float32 in [0, 1] as words [h, w]; exact for multiples of 1 / 255."""
    for y in range(since, until):
        for x in range(picture.shape[1]):
            word = np.int32(0)
            for c in range(3):
                value = min(max(picture[y, x, c], np.float32(0)), np.float32(1))
                word = (word << 10) | np.int32(value * np.float32(1020) + np.float32(0.5))
            out[y, x] = word


@woven
def _beside(anchors, n, ax, ay, reach):
    """Whether the anchors of the pixels n .. n + 15 lie near (ax, ay), lane by lane.

    Beyond the picture's ends they are its first or last one's: there are no shifts there.
    """
    last = anchors.size // 2 - 1
    if n >= 0 and n + 15 <= last:
        bx, by = load_pairs(anchors, 2 * n)
    else:
        pixel = _minimum(_maximum(_iota() + np.int32(n), np.int32(0)), np.int32(last))
        bx = gather_signed(anchors, pixel * np.int32(2))
        by = gather_signed(anchors, pixel * np.int32(2) + np.int32(1))
    return _absolute(ax - bx) + _absolute(ay - by) < reach


@woven
def _votes(x, z, xs, zs):
    """How many of the nine shifts ``xs``, ``zs`` are (x, z), lane by lane."""
    one, zero = _floats(np.float32(1)), np.float32(0)
    first = _where((xs[0] == x) & (zs[0] == z), one, zero)
    other = _where((xs[1] == x) & (zs[1] == z), one, zero)
    first += _where((xs[2] == x) & (zs[2] == z), one, zero)
    other += _where((xs[3] == x) & (zs[3] == z), one, zero)
    first += _where((xs[4] == x) & (zs[4] == z), one, zero)
    other += _where((xs[5] == x) & (zs[5] == z), one, zero)
    first += _where((xs[6] == x) & (zs[6] == z), one, zero)
    other += _where((xs[7] == x) & (zs[7] == z), one, zero)
    return first + other + _where((xs[8] == x) & (zs[8] == z), one, zero)


@woven
def _stand(x, z, xs, zs, anchors, n, ax, ay, reach, known, most, own_x, own_z):
    """The winner so far, or (x, z) of the pixels n .. n + 15 where it has more votes."""
    votes = _votes(x, z, xs, zs)
    better = known & (votes > most)
    if _bits(better) != 0:
        better = better & _beside(anchors, n, ax, ay, reach)
        most = _where(better, votes, most)
        own_x, own_z = _where(better, x, own_x), _where(better, z, own_z)
    return most, own_x, own_z


@lean_kernel
def _elect_of_nine(since, until, anchor, reach, shift, width, out):
    """`elect` of some rows for a radius of 1: all nine shifts stay in registers."""
    anchors = anchor.reshape(-1)
    stride, plane = shift.shape[2], shift.shape[1] * shift.shape[2]
    values, outs = shift.reshape(-1), out.reshape(-1)
    half = np.float32(4.5)
    across = (width + 15) // 16
    for vector in range(since * across, until * across):
        y, first = vector // across, vector % across * 16
        a = y * stride + first
        b, c = a + stride, a + 2 * stride
        xs = (_load(values, a), _load(values, a + 1), _load(values, a + 2),
              _load(values, b), _load(values, b + 1), _load(values, b + 2),
              _load(values, c), _load(values, c + 1), _load(values, c + 2))
        a, b, c = plane + a, plane + b, plane + c
        zs = (_load(values, a), _load(values, a + 1), _load(values, a + 2),
              _load(values, b), _load(values, b + 1), _load(values, b + 2),
              _load(values, c), _load(values, c + 1), _load(values, c + 2))
        x, z = xs[4], zs[4]
        known, most = x == x, _votes(x, z, xs, zs)
        # A majority can't be beaten, and a pixel without a shift gets none.
        if _bits((most < half) & known) != 0:
            n = y * width + first
            ax, ay = pairs(anchors, n)
            m, p = n - width - 1, n + width - 1
            most, x, z = _stand(xs[0], zs[0], xs, zs, anchors, m, ax, ay, reach, known, most, x, z)
            most, x, z = _stand(xs[1], zs[1], xs, zs, anchors, m + 1, ax, ay, reach, known, most,
                                x, z)
            most, x, z = _stand(xs[2], zs[2], xs, zs, anchors, m + 2, ax, ay, reach, known, most,
                                x, z)
            most, x, z = _stand(xs[3], zs[3], xs, zs, anchors, n - 1, ax, ay, reach, known, most,
                                x, z)
            most, x, z = _stand(xs[5], zs[5], xs, zs, anchors, n + 1, ax, ay, reach, known, most,
                                x, z)
            most, x, z = _stand(xs[6], zs[6], xs, zs, anchors, p, ax, ay, reach, known, most, x, z)
            most, x, z = _stand(xs[7], zs[7], xs, zs, anchors, p + 1, ax, ay, reach, known, most,
                                x, z)
            most, x, z = _stand(xs[8], zs[8], xs, zs, anchors, p + 2, ax, ay, reach, known, most,
                                x, z)
        middle = (y + 1) * stride + first + 1
        _store(outs, middle, x)
        _store(outs, plane + middle, z)


@lean_kernel
def _elect_of_many(since, until, anchor, reach, shift, radius, width, out):
    """`elect` of some rows."""
    anchors = anchor.reshape(-1)
    stride, plane = shift.shape[2], shift.shape[1] * shift.shape[2]
    values, outs = shift.reshape(-1), out.reshape(-1)
    side = 2 * radius + 1
    zero, one, half = np.float32(0), np.float32(1), np.float32(side * side) / np.float32(2)
    across = (width + 15) // 16
    for vector in range(since * across, until * across):
        y, first = vector // across, vector % across * 16
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
            ax, ay = pairs(anchors, here)
            for a in range(side * side):
                n = corner + (a // side) * stride + a % side
                other_x, other_z = _load(values, n), _load(values, plane + n)
                votes = _floats(zero)
                for b in range(side * side):
                    m = corner + (b // side) * stride + b % side
                    alike = ((_load(values, m) == other_x) & (_load(values, plane + m) == other_z))
                    votes += _where(alike, _floats(one), zero)
                near = _beside(anchors, here + (a // side - radius) * width
                               + a % side - radius, ax, ay, reach)
                better = (votes > most) & (x == x) & near
                most = _where(better, votes, most)
                own_x, own_z = _where(better, other_x, own_x), _where(better, other_z, own_z)
        _store(outs, middle, own_x)
        _store(outs, plane + middle, own_z)


def elect(anchor, reach, shift, radius, width, out):
    """Mode filter: the most frequent shift of each window of side 2 radius + 1, into ``out``.

    ``shift`` and ``out`` are planes with a margin of ``radius``, of ``width`` pixels. The centre's
    shift stays unless another one has more votes; the first in scan order wins among equals. A
    shift of a pixel whose anchor is not within ``reach`` (L1) is no candidate: it belongs to
    another piece of the anchor plane.
    """
    rows = shift.shape[1] - 2 * radius
    if radius == 1:
        share_out(_elect_of_nine, rows, anchor, reach, shift, width, out)
    else:
        share_out(_elect_of_many, rows, anchor, reach, shift, radius, width, out)


@numba.njit(cache=True, inline="always")
def _channels(word):
    """Red, green and blue of packed colors, lane by lane, 0 to 1020."""
    ten, bits = np.int32(10), np.int32(1023)
    return (_floats((word >> np.int32(20)) & bits), _floats((word >> ten) & bits),
            _floats(word & bits))


@woven
def _sample(colors, height, width, x, y, exact):
    """Color of the packed picture at the continuous places (x, y), clamped inside, 0 to 1020."""
    zero, half = np.float32(0), np.float32(0.5)
    right, bottom = np.float32(width - 1), np.float32(height - 1)
    pitch = np.int32(width)
    if exact:
        i = _ints(_minimum(_maximum(_floor(x), zero), right))
        j = _ints(_minimum(_maximum(_floor(y), zero), bottom))
        return _channels(gather_signed(colors, j * pitch + i))
    x, y = _minimum(_maximum(x - half, zero), right), _minimum(_maximum(y - half, zero), bottom)
    i, j = _minimum(_ints(x), np.int32(width - 2)), _minimum(_ints(y), np.int32(height - 2))
    fx, fy = x - _floats(i), y - _floats(j)
    n = j * pitch + i
    left, right_one = gather_neighbours(colors, n)
    ar, ag, ab = _channels(left)
    br, bg, bb = _channels(right_one)
    left, right_one = gather_neighbours(colors, n + pitch)
    cr, cg, cb = _channels(left)
    dr, dg, db = _channels(right_one)
    ar, ag, ab = ar + fx * (br - ar), ag + fx * (bg - ag), ab + fx * (bb - ab)
    cr, cg, cb = cr + fx * (dr - cr), cg + fx * (dg - cg), cb + fx * (db - cb)
    return ar + fy * (cr - ar), ag + fy * (cg - ag), ab + fy * (cb - ab)


@woven
def _counted(x, z, voters, own_x, own_z, votes):
    """Count (x, z) where it is the shift counted here, or none is yet; and who is left."""
    mine = voters & ((votes == np.float32(0)) | ((x == own_x) & (z == own_z)))
    one, zero = _floats(np.float32(1)), np.float32(0)
    return (_where(mine, x, own_x), _where(mine, z, own_z), votes + _where(mine, one, zero),
            voters & ~mine)


@shared("out")
@lean_kernel
def vote(since, until, colors, anchor, reach, shift, margin, radius, exact, out):
    """Mean of the colors that the window's shifts vote for, into ``out`` [H, W, 3] float32.

    ``shift`` are planes with a ``margin`` of at least ``radius``; ``colors`` int32 [h, w] packed.
    Pixels without a shift (NaN) stay 0. ``exact`` reads whole pixels, else bilinearly. Pixels whose
    anchor is not within ``reach`` (L1) have no vote: their shifts mean other places here.
    """
    width = out.shape[1]
    style_height, style_width = colors.shape
    stride, plane = shift.shape[2], shift.shape[1] * shift.shape[2]
    values, anchors, flat = shift.reshape(-1), anchor.reshape(-1), colors.reshape(-1)
    flat_out = out.reshape(-1)
    zero, one = np.float32(0), np.float32(1)
    across = (width + 15) // 16
    for vector in range(since * across, until * across):
        y, first = vector // across, vector % across * 16
        middle = (y + margin) * stride + margin + first
        x, z = _load(values, middle), _load(values, plane + middle)
        known = x == x
        if _bits(known) == 0:
            for n in range(min(16, width - first)):
                out[y, first + n, 0] = out[y, first + n, 1] = out[y, first + n, 2] = zero
            continue
        here = y * width + first
        ax, ay = pairs(anchors, here)
        ax, ay = _where(known, ax, zero), _where(known, ay, zero)
        red, green, blue = _sample(flat, style_height, style_width, ax + _where(known, x, zero),
                                   ay + _where(known, z, zero), exact)
        count = _floats(one)
        if radius > 0:
            # Few shifts meet in a window: those that differ from the middle's are counted first,
            # up to three at a pixel, and looked up once each.
            own_votes, none = _floats(one), _floats(zero)
            x1, z1, n1, x2, z2, n2, x3, z3, n3 = x, z, none, x, z, none, x, z, none
            more_red, more_green, more_blue = none, none, none
            for v in range(-radius, radius + 1):
                for u in range(-radius, radius + 1):
                    if u == 0 and v == 0:
                        continue
                    n = middle + v * stride + u
                    tx, tz = _load(values, n), _load(values, plane + n)
                    own = (tx == x) & (tz == z)
                    own_votes += _where(own, _floats(one), zero)
                    rest = (tx == tx) & known & ~own
                    if _bits(rest) == 0:
                        continue
                    rest = rest & _beside(anchors, here + v * width + u, ax, ay, reach)
                    x1, z1, n1, rest = _counted(tx, tz, rest, x1, z1, n1)
                    if _bits(rest) == 0:
                        continue
                    x2, z2, n2, rest = _counted(tx, tz, rest, x2, z2, n2)
                    x3, z3, n3, rest = _counted(tx, tz, rest, x3, z3, n3)
                    if _bits(rest) != 0:
                        r, g, b = _sample(flat, style_height, style_width,
                                          ax + _where(rest, tx, zero), ay + _where(rest, tz, zero),
                                          exact)
                        more_red += _where(rest, r, zero)
                        more_green += _where(rest, g, zero)
                        more_blue += _where(rest, b, zero)
                        count += _where(rest, _floats(one), zero)
            red = red * own_votes + more_red
            green, blue = green * own_votes + more_green, blue * own_votes + more_blue
            count += own_votes - one + n1 + n2 + n3
            if _bits(n1 > zero) != 0:
                r, g, b = _sample(flat, style_height, style_width, ax + _where(known, x1, zero),
                                  ay + _where(known, z1, zero), exact)
                red, green, blue = red + n1 * r, green + n1 * g, blue + n1 * b
            if _bits(n2 > zero) != 0:
                r, g, b = _sample(flat, style_height, style_width, ax + _where(known, x2, zero),
                                  ay + _where(known, z2, zero), exact)
                red, green, blue = red + n2 * r, green + n2 * g, blue + n2 * b
            if _bits(n3 > zero) != 0:
                r, g, b = _sample(flat, style_height, style_width, ax + _where(known, x3, zero),
                                  ay + _where(known, z3, zero), exact)
                red, green, blue = red + n3 * r, green + n3 * g, blue + n3 * b
        share = _where(known, np.float32(1 / 1020) / count, zero)
        red, green, blue = red * share, green * share, blue * share
        if first + 16 <= width:
            store_triples(flat_out, 3 * here, red, green, blue)
        else:
            for n in range(width - first):
                out[y, first + n, 0] = _lane(red, n)
                out[y, first + n, 1] = _lane(green, n)
                out[y, first + n, 2] = _lane(blue, n)


@shared("cover")
@lean_kernel
def blend(since, until, photo, scale, painted, cover, out):
    """``photo`` times ``scale``, covered by ``painted`` where ``cover`` [H, W] is 1; float32."""
    width = cover.shape[1]
    for y in range(since, until):
        for x in range(width):
            share = cover[y, x]
            for c in range(3):
                base = np.float32(photo[y, x, c]) * scale
                out[y, x, c] = base + share * (painted[y, x, c] - base)
