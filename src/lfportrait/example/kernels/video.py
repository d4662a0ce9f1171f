"""Hot loops of the transfer to videos: planes carried along by a coarse flow, and flicker.

The flow comes on blocks of ``factor`` pixels: ``motion`` [h, w, 2] is the place in the frame before
minus the place in this one, at the blocks' middles, in pixels; it is bilinear between.
"""

import numba
import numpy as np

from ...simd.decorators import kernel, lean_kernel
from ...simd.threads import shared


@numba.njit(cache=True, inline="always")
def _place(n, factor, count):
    """Block before pixel ``n``, the next one, and the latter's share, of ``count`` blocks."""
    half = np.float32(0.5)
    at = (np.float32(n) + half) / np.float32(factor) - half
    at = min(max(at, np.float32(0)), np.float32(count - 1))
    block = np.int64(at)
    return block, min(block + 1, count - 1), at - np.float32(block)


@numba.njit(cache=True, inline="always")
def _source(motion, factor, y, x):
    """Where pixel (y, x) was in the frame before, in samples: (row, column)."""
    j, below, fy = _place(y, factor, motion.shape[0])
    i, right, fx = _place(x, factor, motion.shape[1])
    a, b, c, d = motion[j, i], motion[j, right], motion[below, i], motion[below, right]
    over_x, under_x = a[0] + fx * (b[0] - a[0]), c[0] + fx * (d[0] - c[0])
    over_y, under_y = a[1] + fx * (b[1] - a[1]), c[1] + fx * (d[1] - c[1])
    return (np.float32(y) + over_y + fy * (under_y - over_y),
            np.float32(x) + over_x + fy * (under_x - over_x))


@numba.njit(cache=True, inline="always")
def _corners(v, u, height, width):
    """Sample above and left of (v, u), clamped inside, and the shares of the next ones."""
    v = min(max(v, np.float32(0)), np.float32(height - 1))
    u = min(max(u, np.float32(0)), np.float32(width - 1))
    j, i = min(np.int64(v), max(height - 2, 0)), min(np.int64(u), max(width - 2, 0))
    return j, i, v - np.float32(j), u - np.float32(i)


@shared("field")
@lean_kernel
def carry(since, until, field, motion, out):
    """``field`` [h, w, C] of the frame before as it lies in this one, bilinear, into ``out``.

    ``motion`` [h, w, 2] comes in samples of the field, one for each.
    """
    height, width, channels = field.shape
    for y in range(since, until):
        for x in range(width):
            j, i, fy, fx = _corners(np.float32(y) + motion[y, x, 1],
                                    np.float32(x) + motion[y, x, 0], height, width)
            below, right = min(j + 1, height - 1), min(i + 1, width - 1)
            for c in range(channels):
                top = field[j, i, c] + fx * (field[j, right, c] - field[j, i, c])
                low = field[below, i, c] + fx * (field[below, right, c] - field[below, i, c])
                out[y, x, c] = top + fy * (low - top)


@shared("out")
@lean_kernel
def carry_shifts(since, until, before, motion, factor, kept, position, anchor, out):
    """Shifts [H, W, 2] of the frame ``before`` as they lie in this one, into ``out``.

    ``motion`` [h, w, 2] is the place before minus the one here, in pixels, of blocks of ``factor``
    pixels; the nearest pixel's shift is taken. Where a block is not ``kept`` (bool [h, w]) it is
    ``position`` minus ``anchor`` [H, W, 2].
    """
    height, width = out.shape[:2]
    half = np.float32(0.5)
    for y in range(since, until):
        j = y // factor
        for x in range(width):
            i = x // factor
            if kept[j, i]:
                v = np.int64(np.floor(np.float32(y) + motion[j, i, 1] + half))
                u = np.int64(np.floor(np.float32(x) + motion[j, i, 0] + half))
                v, u = min(max(v, 0), height - 1), min(max(u, 0), width - 1)
                out[y, x, 0], out[y, x, 1] = before[v, u, 0], before[v, u, 1]
            else:
                out[y, x, 0] = position[y, x, 0] - anchor[y, x, 0]
                out[y, x, 1] = position[y, x, 1] - anchor[y, x, 1]


@shared("out")
@lean_kernel
def trust(since, until, back, there, most, out):
    """Where the flow ``back`` [h, w, 2] stays in the picture and agrees with the one ``there``.

    ``out`` bool [h, w]: going back and there again ends at most ``most`` samples off along an axis.
    """
    height, width = out.shape
    half = np.float32(0.5)
    for y in range(since, until):
        for x in range(width):
            v, u = np.float32(y) + back[y, x, 1], np.float32(x) + back[y, x, 0]
            inside = (-half < u < np.float32(width) - half
                      and -half < v < np.float32(height) - half)
            j, i, fy, fx = _corners(v, u, height, width)
            below, right = min(j + 1, height - 1), min(i + 1, width - 1)
            off = np.float32(0)
            for c in range(2):
                top = there[j, i, c] + fx * (there[j, right, c] - there[j, i, c])
                low = there[below, i, c] + fx * (there[below, right, c] - there[below, i, c])
                off = max(off, abs(back[y, x, c] + top + fy * (low - top)))
            out[y, x] = inside and off < most


@numba.njit(cache=True, inline="always")
def _whole(anchor, y, x, v, u, low, high):
    """Whether the squared step between two neighbours lies between ``low`` and ``high``."""
    if not (0 <= v < anchor.shape[0] and 0 <= u < anchor.shape[1]):
        return False
    dx, dy = anchor[v, u, 0] - anchor[y, x, 0], anchor[v, u, 1] - anchor[y, x, 1]
    step = dx * dx + dy * dy
    return low < step < high


@shared("anchor")
@lean_kernel
def repair(since, until, anchor, trusted, factor, scale, least, most, turn, offset, out):
    """A carried anchor plane [h, w, 2], restarted where it is unreliable or torn, into ``out``.

    Values lie in the middles of blocks of ``factor`` pixels; ``trusted`` bool [h, w]. Torn is where
    the steps to both neighbours in a row, or in a column, are not between ``least`` and ``most``
    times that of a new plane, ``scale`` a pixel. A step on one side alone is the border of a piece
    that is whole: were it torn, too, pieces would shrink from frame to frame. The new plane is
    ``turn`` z + ``offset`` in complex numbers, z the place in pixels.
    """
    width = anchor.shape[1]
    half, pixels = np.float32(0.5), np.float32(factor)
    side = pixels * scale
    low, high = (least * side) ** 2, (most * side) ** 2
    right, down = np.float32(turn.real), np.float32(turn.imag)
    first_x, first_y = np.float32(offset.real), np.float32(offset.imag)
    for y in range(since, until):
        for x in range(width):
            if (trusted[y, x]
                    and (_whole(anchor, y, x, y, x + 1, low, high)
                         or _whole(anchor, y, x, y, x - 1, low, high))
                    and (_whole(anchor, y, x, y + 1, x, low, high)
                         or _whole(anchor, y, x, y - 1, x, low, high))):
                out[y, x, 0], out[y, x, 1] = anchor[y, x, 0], anchor[y, x, 1]
            else:
                u, v = (np.float32(x) + half) * pixels, (np.float32(y) + half) * pixels
                out[y, x, 0] = right * u - down * v + first_x
                out[y, x, 1] = down * u + right * v + first_y


@shared("out")
@kernel
def unfold(since, until, coarse, factor, scale, most, out):
    """An anchor plane on blocks [h, w, 2] at all pixels ``out`` [H, W, 2].

    Bilinear; beyond the outermost middles, and between blocks that are torn apart (steps above
    ``most`` times that of a new plane), each block goes on by ``scale`` a pixel.
    """
    width = out.shape[1]
    rows, columns = coarse.shape[:2]
    half, one, zero = np.float32(0.5), np.float32(1), np.float32(0)
    share = one / np.float32(factor)
    limit = (most * scale * np.float32(factor)) ** 2
    for y in range(since, until):
        v = (np.float32(y) + half) * share - half
        j = min(max(np.int64(np.floor(v)), 0), max(rows - 2, 0))
        below = min(j + 1, rows - 1)
        fy = v - np.float32(j)
        # Which gaps between two blocks are whole, and the values on this row at the blocks.
        line = np.empty((columns, 2), np.float32)
        whole = np.empty(columns, np.bool_)
        inner = zero <= fy <= one and below > j
        for i in range(columns):
            dx, dy = coarse[below, i, 0] - coarse[j, i, 0], coarse[below, i, 1] - coarse[j, i, 1]
            whole[i] = inner and dx * dx + dy * dy < limit
            if whole[i]:
                line[i, 0], line[i, 1] = coarse[j, i, 0] + fy * dx, coarse[j, i, 1] + fy * dy
            else:
                nearest = j if fy < half else below
                line[i, 0] = coarse[nearest, i, 0]
                line[i, 1] = coarse[nearest, i, 1] + scale * (
                    v - np.float32(nearest)) * np.float32(factor)
        for x in range(width):
            u = (np.float32(x) + half) * share - half
            i = min(max(np.int64(np.floor(u)), 0), max(columns - 2, 0))
            right = min(i + 1, columns - 1)
            fx = u - np.float32(i)
            dx, dy = line[right, 0] - line[i, 0], line[right, 1] - line[i, 1]
            if whole[i] and whole[right] and zero <= fx <= one and dx * dx + dy * dy < limit:
                out[y, x, 0], out[y, x, 1] = line[i, 0] + fx * dx, line[i, 1] + fx * dy
            else:
                nearest = i if fx < half else right
                out[y, x, 0] = line[nearest, 0] + scale * (
                    u - np.float32(nearest)) * np.float32(factor)
                out[y, x, 1] = line[nearest, 1]


@shared("sums")
@lean_kernel
def squared_changes(since, until, image, before, motion, factor, trusted, step, sums):
    """Sums over a row of blocks, at the blocks' middles where ``trusted``, into ``sums`` [h, 8].

    Every ``step``-th block of every ``step``-th row counts.
    Count; squared difference to the frame ``before`` carried along, of all channels; sum of each
    channel; squares of each channel in one.
    """
    height, width = image.shape[:2]
    for j in range(since, until):
        for k in range(sums.shape[1]):
            sums[j, k] = 0
        if j % step != 0:
            continue
        y = min(j * factor + factor // 2, height - 1)
        for i in range(0, trusted.shape[1], step):
            if not trusted[j, i]:
                continue
            x = min(i * factor + factor // 2, width - 1)
            v, u = _source(motion, factor, y, x)
            n, m, fy, fx = _corners(v, u, height, width)
            below, right = min(n + 1, height - 1), min(m + 1, width - 1)
            sums[j, 0] += 1
            for c in range(3):
                top = before[n, m, c] + fx * (before[n, right, c] - before[n, m, c])
                low = before[below, m, c] + fx * (before[below, right, c] - before[below, m, c])
                value = image[y, x, c]
                sums[j, 1] += (value - (top + fy * (low - top))) ** 2
                sums[j, 2 + c] += value
                sums[j, 5 + c] += value * value


@shared("image")
@lean_kernel
def to_bytes(since, until, image, out):
    """A picture [H, W, 3] in [0, 1] as uint8."""
    for y in range(since, until):
        for x in range(image.shape[1]):
            for c in range(3):
                value = min(max(image[y, x, c], np.float32(0)), np.float32(1))
                out[y, x, c] = np.uint8(value * np.float32(255) + np.float32(0.5))
