"""Hot loops of the ground behind a head: looked up by the sub-pixels of a panel, and by pictures.

The ground is a plane parallel to the panel. All sub-pixels of a row look at one line of it, so that
a line is mixed once, and a sub-pixel then mixes two of its texels.
"""

import numpy as np

from ...simd.decorators import identified, kernel, lean, lean_kernel
from ...simd.threads import shared
from ...simd.vectors import LANES
from .panel import eye_of

_floats, _gather, _ints, _load, _store = (LANES.floats, LANES.gather, LANES.ints, LANES.load,
                                          LANES.store)
_floor, _iota, _lane, _maximum, _minimum, _where = (
    LANES.floor, LANES.iota, LANES.lane, LANES.maximum, LANES.minimum, LANES.where)


@shared("rows")
@lean_kernel
def shade_ground(since, until, picture, rows, columns, shade, down, across, out):
    """A part of a picture in its shadow, as planes.

    Parameters
    ----------
    picture : uint8 [h, w, 3].
    rows, columns : int64 [R], [C]: which of its rows and columns.
    shade : float32 [a, b], what is left of the light.
    down, across : float32 [R], [C]: where they lie in ``shade``, in its pixels from the first
        one's middle; from 0 to a - 1 and b - 1.
    out : float32 [3, R, C], 0 to 255.
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
    planes : float32 [3, R, C], the ground, 0 to 255 (`shade_ground`).
    line : float64 [H], where each row looks, in rows of the ground.
    base : float32 [4, W * 3], where a sub-pixel looks from the middle of the eyes' line, in
        columns; row of the panel mod 4. Those of the second and third plane are C and 2 C
        further.
    turn : Columns to the left for each unit that an eye is to the right.
    mask, fixed, eyes, panel : As `encode_kernel` has them.
    out : uint8 [H, W * 3].
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


@identified("ground mirrored")
@lean
def _mirrored(place, size):
    """Places (lanes) within ``size`` texels whose mirror images lie side by side."""
    last = np.float32(size - 1)
    turned = place - np.float32(2.0) * last * _floor(place * (np.float32(0.5) / last))
    return _where(turned > last, np.float32(2.0) * last - turned, turned)


@shared("out")
@identified("view ground")
@kernel
def view_ground(since, until, planes, origin, across, down, corner, out):
    """What a camera sees of the ground.

    Parameters
    ----------
    planes : float32 [3, R, C], the ground, 0 to 255.
    origin, across, down, corner : float64 [3] in texels (column, row, and height above the
        ground): the camera's place; its ray's growth for a pixel to the right and below, and
        the first one's.
    out : float32 [H, W, 3] in [0, 1]; beyond the borders of the planes they are mirrored.
    """
    high, wide = planes.shape[1], planes.shape[2]
    width = out.shape[1]
    flat = planes.reshape(planes.size)
    # Where a row of pixels looks at one line of the ground, that is mixed once.
    level = across[1] == 0.0 and across[2] == 0.0
    lines = np.zeros(3 * wide, np.float32)
    seen = np.zeros(48, np.float32)
    unit, zero = np.float32(1.0 / 255.0), np.float32(0.0)
    # Rays that never get there see it as it is far away.
    least = np.float32(1e-3 * origin[2])
    height = np.float32(origin[2])
    last_x, last_y = np.float32(wide - 2), np.float32(high - 2)
    for y in range(since, until):
        ray_x, ray_y = corner[0] + y * down[0], corner[1] + y * down[1]
        sink = -(corner[2] + y * down[2])
        if level:
            line = _floats(np.float32(origin[1] + origin[2] / max(sink, 1e-3 * origin[2]) * ray_y))
            place = _lane(_mirrored(line, high), 0)
            row = min(int(place), high - 2)
            for c in range(3):
                _mix(planes[c, row], planes[c, row + 1], place - np.float32(row),
                     lines[c * wide:(c + 1) * wide])
        for x in range(0, width, 16):
            step = _floats(_iota() + np.int32(x))
            reach = height / _maximum(np.float32(sink) - np.float32(across[2]) * step, least)
            u = _mirrored(np.float32(origin[0]) + reach * (
                np.float32(ray_x) + np.float32(across[0]) * step), wide)
            i = _ints(_minimum(u, last_x))
            right = u - _floats(i)
            if level:
                for c in range(3):
                    at = i + np.int32(c * wide)
                    left = _gather(lines, at)
                    _store(seen, np.uintp(16 * c), unit * (
                        left + right * (_gather(lines, at + np.int32(1)) - left)))
            else:
                v = _mirrored(np.float32(origin[1]) + reach * (
                    np.float32(ray_y) + np.float32(across[1]) * step), high)
                j = _ints(_minimum(v, last_y))
                low = v - _floats(j)
                first = j * np.int32(wide) + i
                for c in range(3):
                    at = first + np.int32(c * high * wide)
                    a, b = _gather(flat, at), _gather(flat, at + np.int32(1))
                    at = at + np.int32(wide)
                    d, e = _gather(flat, at), _gather(flat, at + np.int32(1))
                    upper, lower = a + right * (b - a), d + right * (e - d)
                    _store(seen, np.uintp(16 * c), unit * (upper + low * (lower - upper)))
            for n in range(min(16, width - x)):
                for c in range(3):
                    out[y, x + n, c] = max(seen[16 * c + n], zero)
