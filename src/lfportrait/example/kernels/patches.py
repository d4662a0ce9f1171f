"""Hot loops of guided patch synthesis: search for the nearest patches, occupancy, votes, levels.

Every target pixel holds the exemplar pixel that the middle of its patch is copied from, as a flat
index (`PatchSynthesis`). A pixel's state says what is done with it: `OUTSIDE` it does not count,
`FOREIGN` it is another pixel's copy, `ACTIVE` it is synthesised, `FIXED` its color is given.
Besides the patches' agreement, a pixel may want to come from near a place: that costs the squared
distance times the pixel's weight, up to a limit.

Pictures are float16 with `CHANNELS` channels a pixel, colors and guides scaled
by the roots of their weights, so that the error of two patches is a plain sum of squares.

The picture is cut into bands of `BAND` rows. A band is searched in scan order, each pixel trying
what its neighbours have found; bands see each other as they were before the pass. So the bands run
in parallel, and the outcome does not depend on how many threads there are. The same holds for the
exemplar's occupancy: a band counts its own moves at once, those of others in the next pass. Were
none counted at once, all patches would leave a crowded place together, for the same next one.
"""

import functools
from typing import Any

import numba
import numpy as np

from ...simd.decorators import identified, kernel, lean_kernel
from ...simd.threads import shared
from ...simd.vectors import LANES

OUTSIDE, FOREIGN, ACTIVE, FIXED = 0, 1, 2, 3

CHANNELS = 8
MARGIN = 2
"""Pixels around a target picture, repeated from its border; also the largest radius of a patch."""
BAND = 32
CELL = 4  # Uses of exemplar pixels are counted in cells of this side.

_floats, _load, _load_half, _total = LANES.floats, LANES.load, LANES.load_half, LANES.total


@functools.cache
def _distance(radius: int) -> Any:
    """Sum of squared differences of two patches of one radius, given up beyond a limit.

    ``target`` and ``source`` are flat, ``first`` and ``other`` the patches' first values,
    ``pitch`` and ``other_pitch`` the values in a row. ``scales`` float32 [48] weighs the channels
    of a row (`_scales`), 0 beyond its end.
    """
    side = 2 * radius + 1
    parts = (side * CHANNELS + 15) // 16
    # Whether it is worth going on is asked once, after so many rows.
    half = radius + 1

    @identified("patch distance", radius)
    @numba.njit(inline="always")
    def distance(target, first, pitch, source, other, other_pitch, scales, limit):
        line = _floats(np.float32(0))
        for row in range(half):
            a, b = first + np.uintp(row) * pitch, other + np.uintp(row) * other_pitch
            for part in range(parts):
                step = (_load_half(target, a + np.uintp(16 * part))
                        - _load_half(source, b + np.uintp(16 * part)))
                line += step * step * _load(scales, np.uintp(16 * part))
        total = _total(line)
        if total < limit:
            for row in range(half, side):
                a, b = first + np.uintp(row) * pitch, other + np.uintp(row) * other_pitch
                for part in range(parts):
                    step = (_load_half(target, a + np.uintp(16 * part))
                            - _load_half(source, b + np.uintp(16 * part)))
                    line += step * step * _load(scales, np.uintp(16 * part))
            total = _total(line)
        return total

    return distance


@numba.njit(inline="always")
def _scales(trust, out):
    """Set the weights of a row's first two guides (`_plain_scales`)."""
    for k in range(3, len(out), CHANNELS):
        if out[k] != 0:
            out[k] = max(trust[0], np.float32(1e-6))
            out[k + 1] = max(trust[1], np.float32(1e-6))


@numba.njit(inline="always")
def _plain_scales(side):
    """Weights of the channels of a row of ``side`` pixels: 1, and 0 beyond its end."""
    out = np.zeros(48, np.float32)
    out[:side * CHANNELS] = 1
    return out


@numba.njit(inline="always")
def _astray(wanted, weight, area, limit, y, x, v, u):
    """What it costs a patch of ``area`` pixels around (x, y) to come from (u, v), not as wanted."""
    if weight[y, x] == 0:
        return np.float32(0)
    across = np.float32(u) + np.float32(0.5) - wanted[y, x, 0]
    down = np.float32(v) + np.float32(0.5) - wanted[y, x, 1]
    return weight[y, x] * area * min(across * across + down * down, limit)


@functools.cache
def patch_errors(radius: int) -> Any:
    """Kernel: error of every patch under the present field.

    Arguments: ``target`` flat float16 bits (uint16) of [H + 2 MARGIN, W + 2 MARGIN, CHANNELS],
    ``source`` those of [h, w, CHANNELS], both with 16 values more at the end, ``across`` = w,
    ``state`` uint8 [H, W], ``trust`` float32 [H, W, 2], factors of the weights of the first two
    guides in a pixel's patch, ``wanted`` float32 [H, W, 2] places (x, y) with their ``weight``
    float32 [H, W], for each pixel of a patch, and ``limit`` (squared distance), ``field`` int32
    [H, W] (flat index v w + u), ``error`` float32 [H, W], filled, 0 outside.
    """
    distance, area = _distance(radius), np.float32((2 * radius + 1) ** 2)

    @shared("error")
    @identified("patch errors", radius)
    @kernel
    def errors(since, until, target, source, across, state, trust, wanted, weight, limit, field,
               error):
        width = field.shape[1]
        pitch = (width + 2 * MARGIN) * CHANNELS
        for y in range(since, until):
            scales = _plain_scales(2 * radius + 1)
            for x in range(width):
                if state[y, x] == OUTSIDE:
                    error[y, x] = 0
                    continue
                place = np.int64(field[y, x])
                v, u = place // across, place % across
                _scales(trust[y, x], scales)
                first = np.uintp((y + MARGIN - radius) * pitch + (x + MARGIN - radius) * CHANNELS)
                other = np.uintp(((v - radius) * across + u - radius) * CHANNELS)
                error[y, x] = (distance(target, first, np.uintp(pitch), source, other,
                                        np.uintp(across * CHANNELS), scales, np.float32(np.inf))
                               + _astray(wanted, weight, area, limit, y, x, v, u))

    return errors


@numba.njit(inline="always")
def _noise(state):
    """Next state of a 64-bit generator (xorshift)."""
    state ^= state << np.uint64(13)
    state ^= state >> np.uint64(7)
    state ^= state << np.uint64(17)
    return state


@functools.cache
def search_pass(radius: int) -> Any:
    """Kernel: one pass of the search over the whole picture.

    Arguments: those of `patch_errors` up to ``limit``; ``uses`` float32 [cells], how many
    patches are copied from each cell (`count_uses`); ``penalty`` float32 [cells], error of each of
    them;
    ``guided`` int32 [H, W], places that the guides alone propose; ``before`` int32 [H, W], a copy
    of the field; ``field`` and ``error``, improved in place; ``reach``, the widest step of the
    random search, halved down to 1; ``forward``, direction of the scan; ``seed``.
    """
    distance, area = _distance(radius), np.float32((2 * radius + 1) ** 2)

    @shared("field", per=BAND)
    @identified("patch search", radius)
    @kernel
    def search(since, until, target, source, across, state, trust, wanted, weight, limit, uses,
               penalty, guided, before, field, error, reach, forward, seed):
        height, width = field.shape
        rows = (len(source) - 16) // (across * CHANNELS)
        pitch = (width + 2 * MARGIN) * CHANNELS
        step = 1 if forward else -1
        for band in range(since, until):
            top, bottom = band * BAND, min((band + 1) * BAND, height)
            crowd = uses * penalty
            scales = _plain_scales(2 * radius + 1)
            for line in range(bottom - top):
                y = top + line if forward else bottom - 1 - line
                for column in range(width):
                    x = column if forward else width - 1 - column
                    if state[y, x] != ACTIVE:
                        continue
                    noise = _noise(_noise(np.uint64(y * width + x + 1)
                                          * np.uint64(0x9E3779B97F4A7C15) ^ np.uint64(seed)))
                    _scales(trust[y, x], scales)
                    first = np.uintp((y + MARGIN - radius) * pitch
                                     + (x + MARGIN - radius) * CHANNELS)
                    own = np.int64(field[y, x])
                    v, u = own // across, own % across
                    best = error[y, x] + crowd[v // CELL, u // CELL]
                    # Neighbours in the direction of the scan, the guides' own place, then random
                    # steps that shrink.
                    width_now = reach
                    for k in range(64):
                        if k == 0:
                            if x - step < 0 or x - step >= width:
                                continue
                            near = np.int64(field[y, x - step])
                            q, p = near // across, near % across + step
                        elif k == 1:
                            above = y - step
                            if above < 0 or above >= height:
                                continue
                            near = np.int64(field[above, x] if top <= above < bottom
                                            else before[above, x])
                            q, p = near // across + step, near % across
                        elif k == 2:
                            near = np.int64(guided[y, x])
                            q, p = near // across, near % across
                        else:
                            if width_now < 1:
                                break
                            noise = _noise(noise)
                            span = np.uint64(2 * width_now + 1)
                            p = u + np.int64((noise >> np.uint64(40)) % span) - width_now
                            q = v + np.int64((noise >> np.uint64(16) & np.uint64(0xFFFFFF))
                                             % span) - width_now
                            width_now //= 2
                        q = min(max(q, MARGIN), rows - 1 - MARGIN)
                        p = min(max(p, MARGIN), across - 1 - MARGIN)
                        if q == v and p == u:
                            continue
                        # Coming, the patch would crowd the cell further; staying, it counts.
                        fine = crowd[q // CELL, p // CELL]
                        if q // CELL != v // CELL or p // CELL != u // CELL:
                            fine += penalty[q // CELL, p // CELL]
                        fixed = fine + _astray(wanted, weight, area, limit, y, x, q, p)
                        if fixed >= best:
                            continue
                        other = np.uintp(((q - radius) * across + p - radius) * CHANNELS)
                        found = distance(target, first, np.uintp(pitch), source, other,
                                         np.uintp(across * CHANNELS), scales, best - fixed)
                        if found + fixed < best:
                            best = found + fixed
                            error[y, x] = best - fine
                            crowd[v // CELL, u // CELL] -= penalty[v // CELL, u // CELL]
                            crowd[q // CELL, p // CELL] += penalty[q // CELL, p // CELL]
                            v, u = q, p
                    field[y, x] = np.int32(v * across + u)

    return search


@lean_kernel
def count_uses(field, state, across, uses):
    """How many patches of active pixels are copied from each cell, into ``uses`` float32 [cells].

    ``field`` int32 [H, W] are flat indices into an exemplar ``across`` pixels wide.
    """
    uses[:] = 0
    for y in range(field.shape[0]):
        for x in range(field.shape[1]):
            if state[y, x] != ACTIVE:
                continue
            place = np.int64(field[y, x])
            uses[place // across // CELL, place % across // CELL] += np.float32(1)


@shared("field")
@lean_kernel
def vote_patches(since, until, field, error, state, picture, radius, softness, out):
    """Mean of the colors that the patches over an active pixel vote for, weighted by their fit.

    ``picture`` float32 [h, w, 3]; ``out`` float32 [H, W, 3] is changed where pixels are active. A
    patch weighs 1 / (``softness`` + its error).
    """
    height, width = field.shape
    rows, across = picture.shape[:2]
    one = np.float32(1)
    for y in range(since, until):
        for x in range(width):
            if state[y, x] != ACTIVE:
                continue
            red = green = blue = total = np.float32(0)
            for j in range(max(y - radius, 0), min(y + radius + 1, height)):
                for i in range(max(x - radius, 0), min(x + radius + 1, width)):
                    if state[j, i] == OUTSIDE:
                        continue
                    place = np.int64(field[j, i])
                    v, u = place // across + y - j, place % across + x - i
                    if v < 0 or v >= rows or u < 0 or u >= across:
                        continue
                    weight = one / (softness + error[j, i])
                    red += weight * picture[v, u, 0]
                    green += weight * picture[v, u, 1]
                    blue += weight * picture[v, u, 2]
                    total += weight
            share = one / total
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = red * share, green * share, blue * share


@shared("out")
@lean_kernel
def level_places(since, until, places, step, size, out):
    """Places of a level's pixels as flat indices, into ``out`` int32 [h, w].

    ``places`` float32 [H, W, 2] (x, y) are those of the finest level, whose pixels in the middle of
    ``step`` x ``step`` are asked; ``size`` (rows, columns) is the exemplar's on the level. Places
    keep a patch's margin from its border; unknown ones (NaN) go to its corner.
    """
    height, width = places.shape[:2]
    rows, columns = size
    least = np.float32(MARGIN)
    low, right = np.float32(rows - 1 - MARGIN), np.float32(columns - 1 - MARGIN)
    share = np.float32(1) / np.float32(step)
    for y in range(since, until):
        v = min(y * step + step // 2, height - 1)
        for x in range(out.shape[1]):
            u = min(x * step + step // 2, width - 1)
            column, row = places[v, u, 0] * share, places[v, u, 1] * share
            # A comparison with NaN is false.
            column = min(column, right) if column > least else least
            row = min(row, low) if row > least else least
            out[y, x] = np.int32(row) * np.int32(columns) + np.int32(column)


@shared("out")
@lean_kernel
def finer_places(since, until, places, across, state, start, size, out):
    """What a level found, on the next finer one, into ``out`` int32 [H, W].

    ``places`` int32 [h, w] are flat indices into an exemplar ``across`` pixels wide, ``size`` is
    (rows, columns) of the finer one; where the ``state`` is `FIXED` ``start`` int32 [H, W] holds.
    """
    rows, columns = size
    for y in range(since, until):
        for x in range(out.shape[1]):
            if state[y, x] == FIXED:
                out[y, x] = start[y, x]
                continue
            place = places[y // 2, x // 2]
            row, column = 2 * (place // across) + y % 2, 2 * (place % across) + x % 2
            row = min(max(row, MARGIN), rows - 1 - MARGIN)
            column = min(max(column, MARGIN), columns - 1 - MARGIN)
            out[y, x] = np.int32(row * columns + column)
