"""Hot loops of the baselines: RMSProp on colors (ARF), FaceBlit's table and flood fill."""

from __future__ import annotations

import numba
import numpy as np

from lfportrait.simd.decorators import kernel, lean_kernel
from lfportrait.simd.threads import share_out, shared


@shared("colors")
@lean_kernel
def rmsprop_step(since, until, colors, gradient, square, rate):
    """RMSProp as in svox2 on colors [N, 3] with gradient [3, N], where it is not zero.

    A color's first slope is its own mean square. Colors stay in [0, 1]; the gradient is set to
    zero.
    """
    keep = np.float32(0.95)
    for row in range(since, until):
        for channel in range(3):
            slope = gradient[channel, row]
            if slope != 0:
                mean = slope * slope
                if square[row, channel] != 0:
                    mean += keep * (square[row, channel] - mean)
                square[row, channel] = mean
                value = colors[row, channel] - rate * slope / (np.sqrt(mean) + np.float32(1e-20))
                colors[row, channel] = min(max(value, np.float32(0)), np.float32(1))
                gradient[channel, row] = np.float32(0)


NOWHERE = np.int32(-1)
"""Marks a pixel that the synthesis has not reached."""

_INDEX_BITS = 28
_MASK = (np.int64(1) << _INDEX_BITS) - 1


@numba.njit(cache=True, inline="always")
def _window(cell, cells, length, reach):
    """First and last + 1 pixel of the window about a cell's place."""
    middle = cell * length // cells
    return max(middle - reach, 0), min(middle + reach + 1, length)


def search_windows(red, green, appearance, place, look, reach, first, last, table):
    """Fill ``table`` [G, R, A] int32 by visiting the whole window for every cell, as published.

    ``red`` [W] and ``green`` [H] are the position guide of the exemplar's columns and rows,
    ``appearance`` [H, W]; all int32. Only the rows of cells ``first`` .. ``last`` - 1 are filled.
    """
    share_out(_search_rows, last - first, red, green, appearance, place, look, reach, first, table)


@lean_kernel
def _search_rows(since, until, red, green, appearance, place, look, reach, begin, table):
    """`search_windows` for some rows of cells, counted from ``begin``."""
    height, width = appearance.shape
    greens, reds, levels = table.shape
    for g in range(begin + since, begin + until):
        top, bottom = _window(g, greens, height, reach)
        for r in range(reds):
            left, right = _window(r, reds, width, reach)
            for a in range(levels):
                best, found = 1 << 30, np.int32(0)
                for y in range(top, bottom):
                    away = place * abs(green[y] - g)
                    for x in range(left, right):
                        error = (away + place * abs(red[x] - r) + look * abs(appearance[y, x] - a))
                        if error < best:
                            best, found = error, np.int32(y * width + x)
                table[g, r, a] = found


@shared("table")
@kernel
def sweep_windows(since, until, red, green, appearance, place, look, reach, table):
    """`search_windows` with the same outcome: a window is visited once for all appearances.

    The best pixel of each appearance is kept, and two sweeps along the appearance axis carry the
    cost and the index on.
    """
    height, width = appearance.shape
    greens, reds, levels = table.shape
    step = np.int64(look) << _INDEX_BITS
    for g in range(since, until):
        top, bottom = _window(g, greens, height, reach)
        keys = np.empty(levels, np.int64)
        for r in range(reds):
            left, right = _window(r, reds, width, reach)
            keys[:] = np.int64(1) << 60
            for y in range(top, bottom):
                away = place * abs(green[y] - g)
                for x in range(left, right):
                    cost = np.int64(away + place * abs(red[x] - r))
                    key = (cost << _INDEX_BITS) | np.int64(y * width + x)
                    a = appearance[y, x]
                    keys[a] = min(keys[a], key)
            for a in range(1, levels):
                keys[a] = min(keys[a], keys[a - 1] + step)
            for a in range(levels - 2, -1, -1):
                keys[a] = min(keys[a], keys[a + 1] + step)
            for a in range(levels):
                table[g, r, a] = np.int32(keys[a] & _MASK)


@kernel
def flood(red, green, appearance, style_red, style_green, style_appearance, seeds, box, place, look,
          threshold, out):
    """Copy coherent chunks: seeds in scan order, grown 4-connected while the error stays small.

    Parameters
    ----------
    red, green, appearance : int32 [H, W], guides of the target.
    style_red, style_green, style_appearance : int32 [w], [h], [h, w], guides of the exemplar.
    seeds : int32 [H, W], flat exemplar index that a pixel takes if it becomes a seed.
    box : (left, top, right, bottom): where seeds are set; chunks may grow out of it.
    place, look, threshold : Weights of the error, and its limit in a chunk. A seed itself is
        always accepted.
    out : int32 [H, W], filled with flat exemplar indices; `NOWHERE` where no chunk has come.
    """
    height, width = red.shape
    style_height, style_width = style_appearance.shape
    out[:] = NOWHERE
    queue = np.empty(height * width, np.int64)
    for top in range(box[1], box[3]):
        for left in range(box[0], box[2]):
            if out[top, left] != NOWHERE:
                continue
            seed = np.int64(seeds[top, left])
            down, right = seed // style_width - top, seed % style_width - left
            out[top, left] = np.int32(seed)
            queue[0] = top * width + left
            first, last = 0, 1
            while first < last:
                pixel = queue[first]
                first += 1
                for k in range(4):
                    y = pixel // width + (1 if k == 0 else -1 if k == 1 else 0)
                    x = pixel % width + (1 if k == 2 else -1 if k == 3 else 0)
                    if y < 0 or y >= height or x < 0 or x >= width or out[y, x] != NOWHERE:
                        continue
                    v, u = y + down, x + right
                    if v < 0 or v >= style_height or u < 0 or u >= style_width:
                        continue
                    error = (place * (abs(red[y, x] - style_red[u])
                                      + abs(green[y, x] - style_green[v]))
                             + look * abs(appearance[y, x] - style_appearance[v, u]))
                    if error < threshold:
                        out[y, x] = np.int32(v * style_width + u)
                        queue[last] = y * width + x
                        last += 1
