"""Hot loops of the ground behind a head: looked up by the sub-pixels of a panel, and by pictures.

The ground is a plane parallel to the panel. All sub-pixels of a row look at one line of it, so that
a line is mixed once, and a sub-pixel then mixes two of its texels.
"""

from __future__ import annotations

import numpy as np

from ...lanes.cache_keys import identified
from ...lanes.decorators import kernel, lean, lean_kernel
from ...lanes.threads import shared
from ...lanes.vectors import LANES
from .encode import eye_of

__all__ = ["fill_ground", "shade_ground", "view_ground"]

_floats, _gather, _ints, _load, _store = (LANES.floats, LANES.gather, LANES.ints, LANES.load,
                                          LANES.store)


@shared("rows")
@lean_kernel
def shade_ground(since, until, picture, rows, columns, shade, down, across, out):
    """A part of a picture in its shadow, as planes.

    Parameters
    ----------
    picture
        uint8 [h, w, 3].
    rows, columns
        int64 [R], [C]: which of its rows and columns.
    shade
        float32 [a, b], what is left of the light.
    down, across
        float32 [R], [C]: where they lie in ``shade``, in its pixels from the first one's middle;
        from 0 to a - 1 and b - 1.
    out
        float32 [3, R, C], 0 to 255.
    """
    last_row, last_column = shade.shape[0] - 2, shade.shape[1] - 2
    for y in range(since, until):
        j = min(int(down[y]), last_row)
        low = down[y] - np.float32(j)
        for x in range(len(columns)):
            i = min(int(across[x]), last_column)
            right = across[x] - np.float32(i)
            upper = shade[j, i] + right * (shade[j, i + 1] - shade[j, i])
            lower = shade[j + 1, i] + right * (shade[j + 1, i + 1] - shade[j + 1, i])
            light = upper + low * (lower - upper)
            for c in range(3):
                out[c, y, x] = light * np.float32(picture[rows[y], columns[x], c])


@shared("out")
@identified("fill ground")
@kernel
def fill_ground(since, until, planes, line, base, turn, mask, fixed, eyes, panel, out):
    """What every sub-pixel of a panel sees of the ground.

    Parameters
    ----------
    planes
        float32 [3, R, C], the ground, 0 to 255 (`shade_ground`).
    line
        float64 [H], where each row looks, in rows of the ground.
    base
        float32 [4, W * 3], where a sub-pixel looks from the middle of the eyes' line, in columns;
        row of the panel mod 4. Those of the second and third plane are C and 2 C further.
    turn
        Columns to the left for each unit that an eye is to the right.
    mask, fixed, eyes, panel
        As `encode_kernel` has them.
    out
        uint8 [H, W * 3].
    """
    high, wide = planes.shape[1], planes.shape[2]
    across = out.shape[1]
    continuous = panel[6] > 0.5 and fixed < 0
    last = len(eyes) - 1
    first_eye = np.float32(eyes[0])
    between = np.float32((eyes[last] - eyes[0]) / max(last, 1))
    step = np.float32(turn)
    texels, pairs = np.zeros(3 * wide + 1, np.float32), np.zeros(3 * wide, np.int32)
    eye = np.zeros(across + 16, np.float32)
    seen = np.zeros(across + 16, np.float32)
    where = np.zeros(across + 16, np.float32)
    for y in range(since, until):
        number = int(panel[4]) + y * int(panel[7])
        row = min(max(int(np.floor(line[y])), 0), high - 2)
        part = np.float32(line[y] - row)
        for c in range(3):
            _mix(planes[c, row], planes[c, row + 1], part, texels[c * wide:(c + 1) * wide])
        _pair(texels, pairs)
        if fixed >= 0:
            eye[:] = np.float32(eyes[fixed])
        elif continuous:
            for x in range(across):
                eye[x] = np.float32(eye_of(x, number, eyes, panel))
        else:
            _eyes(mask[y], first_eye, between, eye)
        _places(base[number % 4], eye, step, where)
        for x in range(0, across, 16):
            place = _load(where, np.uintp(x))
            index = _ints(place)
            share = place - _floats(index)
            pair = _gather(pairs, index)
            left = _floats(pair & np.int32(0xFFFF))
            right = _floats(pair >> np.int32(16))
            _store(seen, np.uintp(x), left + share * (right - left))
        _round(seen, out[y])


@lean
def _mix(upper, lower, part, out):
    """A line between two others."""
    for x in range(len(out)):
        out[x] = upper[x] + part * (lower[x] - upper[x])


@lean
def _pair(values, out):
    """Each value of 0 to 255 and the next one in 128ths, in one number: one look-up finds both."""
    for x in range(len(out)):
        left = np.int32(values[x] * np.float32(128.0) + np.float32(0.5))
        right = np.int32(values[x + 1] * np.float32(128.0) + np.float32(0.5))
        out[x] = left | right << np.int32(16)


@lean
def _eyes(views, first, between, out):
    """The eyes of a row's views: they are equally far apart."""
    for x in range(len(views)):
        out[x] = first + between * np.float32(views[x])


@lean
def _places(base, eye, step, out):
    """Where a row's sub-pixels look."""
    for x in range(len(base)):
        out[x] = base[x] - step * eye[x]


@lean
def _round(values, out):
    """128ths of values of 0 to 255 as bytes."""
    for x in range(len(out)):
        out[x] = np.uint8(values[x] * np.float32(1.0 / 128.0) + np.float32(0.5))


@shared("out")
@lean_kernel
def view_ground(since, until, planes, origin, across, down, corner, out):
    """What a camera sees of the ground.

    Parameters
    ----------
    planes
        float32 [3, R, C], the ground, 0 to 255.
    origin, across, down, corner
        float64 [3] in texels (column, row, and height above the ground): the camera's place; its
        ray's growth for a pixel to the right and below, and the first one's.
    out
        float32 [H, W, 3] in [0, 1]; beyond the borders of the planes they are mirrored.
    """
    high, wide = planes.shape[1], planes.shape[2]
    for y in range(since, until):
        for x in range(out.shape[1]):
            sink = -(corner[2] + x * across[2] + y * down[2])
            # Rays that never get there see it as it is far away.
            reach = origin[2] / max(sink, 1e-3 * origin[2])
            u = origin[0] + reach * (corner[0] + x * across[0] + y * down[0])
            v = origin[1] + reach * (corner[1] + x * across[1] + y * down[1])
            u, v = _mirrored(u, wide), _mirrored(v, high)
            i, j = min(int(u), wide - 2), min(int(v), high - 2)
            right, low = u - i, v - j
            for c in range(3):
                upper = planes[c, j, i] + right * (planes[c, j, i + 1] - planes[c, j, i])
                lower = (planes[c, j + 1, i]
                         + right * (planes[c, j + 1, i + 1] - planes[c, j + 1, i]))
                out[y, x, c] = (upper + low * (lower - upper)) * (1.0 / 255.0)


@lean
def _mirrored(place, size):
    """A place within ``size`` texels whose mirror images lie side by side."""
    last = size - 1.0
    turned = place - 2.0 * last * np.floor(place / (2.0 * last))
    return 2.0 * last - turned if turned > last else turned
