"""Hot loops of jittered grids: the seeds of StyleBlit (Sykora et al. 2019), and the nearest site.

Seeds lie in the anchor plane. Cells of all levels stand one after the other in flat arrays; each
level has a border of empty cells, and an empty cell's seed lies at infinity, so that the search for
the nearest seed needs no bounds.

Sites of a patchwork are the jittered middles of square cells, one each; the nearest one lies in the
place's own cell or in one of the eight around it.
"""

import numba
import numpy as np

from ...simd.decorators import lean, lean_kernel
from ...simd.interleaved import load_pairs
from ...simd.threads import share_out, shared
from ...simd.vectors import LANES

_M1, _M2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_K1, _K2, _K3 = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F),
                 np.uint64(0x165667B19E3779F9))
_S30, _S27, _S31, _S32, _S40 = (np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(32),
                                np.uint64(40))
_floats, _where, _lane = LANES.floats, LANES.where, LANES.lane
_minimum, _maximum = LANES.minimum, LANES.maximum
_NOTHING = np.uint64(0xFFFFFFFFFFFFFFFF)


@numba.njit(cache=True, inline="always")
def _mix(value):
    """Finaliser of splitmix64: an integer hash with full avalanche."""
    value = (value ^ (value >> _S30)) * _M1
    value = (value ^ (value >> _S27)) * _M2
    return value ^ (value >> _S31)


@lean
def _jitter(seed, level, i, j, axis):
    """Uniform number in [0, 1) that depends on the counters alone."""
    key = _mix(np.uint64(seed) * _K1 + np.uint64(level * 2 + axis))
    key = _mix(key ^ (np.uint64(i) * _K2))
    key = _mix(key ^ (np.uint64(j) * _K3))
    return np.float32(np.float64(key >> _S40) / 16777216.0)


@lean_kernel
def seed_points(seed, level, first_x, first_y, points):
    """Jittered seeds of the cells (first_x + i, first_y + j), side 2^level, into [Y, X, 2]."""
    side = np.float32(1 << level)
    for j in range(points.shape[0]):
        for i in range(points.shape[1]):
            x, y = np.int64(first_x + i), np.int64(first_y + j)
            points[j, i, 0] = side * (np.float32(x) + _jitter(seed, level, x, y, 0))
            points[j, i, 1] = side * (np.float32(y) + _jitter(seed, level, x, y, 1))


@lean_kernel
def seed_regular(points, scale, height, width, pixels):
    """Pixel under each seed where the anchor is ``scale`` times the pixel; -1 outside."""
    for j in range(points.shape[0]):
        for i in range(points.shape[1]):
            x = np.int64(np.floor(points[j, i, 0] / scale))
            y = np.int64(np.floor(points[j, i, 1] / scale))
            inside = 0 <= x < width and 0 <= y < height
            pixels[j, i] = y * width + x if inside else -1
            if not inside:
                points[j, i, 0] = points[j, i, 1] = np.float32(np.inf)


@lean_kernel
def _splat_finest(anchor, share, first_x, first_y, start, columns, points, nearest):
    """Pixel nearest to each seed of the finest level among those in its cell, into ``nearest``.

    ``share`` is one over the cells' side. ``nearest`` uint64 [rows * columns] holds the squared
    distance in its upper half and the pixel in its lower one, so that one comparison without a
    branch decides; the first in scan order wins among equals.
    """
    width = anchor.shape[1]
    left, top = np.float32(first_x), np.float32(first_y)
    for y in range(anchor.shape[0]):
        for x in range(width):
            ax, ay = anchor[y, x, 0], anchor[y, x, 1]
            if not np.isfinite(ax):
                continue
            # Cells count from the first, so that cutting off the fraction is rounding down.
            n = np.uintp(np.uint32(ay * share - top) * np.uint32(columns)
                         + np.uint32(ax * share - left))
            dx, dy = ax - points[start + n, 0], ay - points[start + n, 1]
            bits = np.uint64(np.float32(dx * dx + dy * dy).view(np.uint32))
            key = (bits << _S32) | np.uint64(y * width + x)
            nearest[n] = min(nearest[n], key)


@lean
def _walk(anchors, width, pixel, x, y):
    """The pixel nearest to (x, y) that steps downhill from ``pixel`` lead to."""
    for _ in range(8):
        dx, dy = anchors[pixel, 0] - x, anchors[pixel, 1] - y
        best, found = dx * dx + dy * dy, pixel
        column = pixel % width
        for down in range(-1, 2):
            for right in range(-1, 2):
                other = pixel + down * width + right
                if 0 <= column + right < width and 0 <= other < anchors.shape[0]:
                    dx, dy = anchors[other, 0] - x, anchors[other, 1] - y
                    distance = dx * dx + dy * dy
                    if distance < best:
                        best, found = distance, np.int32(other)
        if found == pixel:
            break
        pixel = found
    return pixel


@lean_kernel
def _nearest_of_finest(since, until, anchors, width, begin, reach, share, first_x, first_y, rows,
                       columns, finest, points, pixels):
    """The pixels nearest to some seeds among those that stand for the finest cells around.

    Rings of cells are searched until one holds a pixel, at the most ``reach``; -1: there is none.
    ``finest`` are the pixels of the finest cells, ``points`` and ``pixels`` all seeds; the seeds
    count from ``begin``, the first of their level.
    """
    for n in range(begin + since, begin + until):
        x, y = points[n, 0], points[n, 1]
        i, j = np.int64(np.floor(x * share)) - first_x, np.int64(np.floor(y * share)) - first_y
        found, best = np.int32(-1), np.float32(np.inf)
        for ring in range(1, reach + 1):
            for v in range(max(j - ring, 0), min(j + ring + 1, rows)):
                # Within the first ring all nine, then the border alone.
                step = 1 if ring == 1 or abs(v - j) == ring else 2 * ring
                for u in range(i - ring, i + ring + 1, step):
                    if not 0 <= u < columns:
                        continue
                    pixel = finest[np.uintp(v * columns + u)]
                    if pixel >= 0:
                        dx, dy = anchors[pixel, 0] - x, anchors[pixel, 1] - y
                        distance = dx * dx + dy * dy
                        if distance < best:
                            best, found = distance, pixel
            if found >= 0:
                break
        if found >= 0:
            found = _walk(anchors, width, found, x, y)
        pixels[n] = found


def seed_splat(anchor, firsts, starts, shapes, finest, points, pixels):
    """Pixel whose anchor is near each seed; -1 where there is none.

    On the finest level it is the nearest one in the seed's cell. On the levels above it is the
    nearest of those pixels: at most one of the finest cells further off than the nearest of all,
    and like that one it depends on the anchors alone. Seeds without a pixel move to infinity.
    """
    height, width = anchor.shape[0], anchor.shape[1]
    anchors = anchor.reshape(height * width, 2)
    begin, (rows, columns), (first_x, first_y) = starts[finest], shapes[finest], firsts[finest]
    share = np.float32(1) / np.float32(1 << finest)
    nearest = np.full(rows * columns, _NOTHING, np.uint64)
    _splat_finest(anchor, share, first_x, first_y, begin, columns, points, nearest)
    # The lower half of a word; no pixel has all bits set there.
    found = nearest.astype(np.uint32).view(np.int32)
    pixels[begin:begin + rows * columns] = found
    for level in range(finest + 1, starts.shape[0]):
        share_out(_nearest_of_finest, int(shapes[level].prod()), anchors, width, starts[level],
                  min(1 << (level - finest), 3), share, first_x, first_y, rows, columns, found,
                  points, pixels)
    points[pixels < 0] = np.inf


@numba.njit(cache=True, inline="always")
def _finite_range_row(row, low, high):
    """`finite_range` of one row: ``row`` [2 W] interleaved, ``low`` and ``high`` [2]."""
    infinite = np.float32(np.inf)
    least_x, least_y, most_x, most_y = infinite, infinite, -infinite, -infinite
    whole = row.size // 32 * 32
    if whole > 0:
        lows, lows_y = _floats(infinite), _floats(infinite)
        highs, highs_y = _floats(-infinite), _floats(-infinite)
        for first in range(0, whole, 32):
            x, y = load_pairs(row, first)
            lows = _minimum(lows, _where(x > -infinite, x, infinite))
            lows_y = _minimum(lows_y, _where(y > -infinite, y, infinite))
            highs = _maximum(highs, _where(x < infinite, x, -infinite))
            highs_y = _maximum(highs_y, _where(y < infinite, y, -infinite))
        for k in range(16):
            least_x, least_y = min(least_x, _lane(lows, k)), min(least_y, _lane(lows_y, k))
            most_x, most_y = max(most_x, _lane(highs, k)), max(most_y, _lane(highs_y, k))
    for n in range(whole, row.size, 2):
        if -infinite < row[n] < infinite:
            least_x, most_x = min(least_x, row[n]), max(most_x, row[n])
        if -infinite < row[n + 1] < infinite:
            least_y, most_y = min(least_y, row[n + 1]), max(most_y, row[n + 1])
    low[0], low[1], high[0], high[1] = least_x, least_y, most_x, most_y


@shared("values")
@lean_kernel
def finite_range(since, until, values, low, high):
    """Least and largest finite value of every row: ``values`` [H, W, 2] into [H, 2] each."""
    height, width = values.shape[:2]
    rows = values.reshape(height, 2 * width)
    for y in range(since, until):
        _finite_range_row(rows[y], low[y], high[y])


@numba.njit(cache=True, inline="always")
def _slope(values, pixel, other, c):
    """Change of a component of pairs from ``pixel`` to ``other``; 0 where one of them is NaN."""
    step = values[2 * other + c] - values[2 * pixel + c]
    return step if np.isfinite(step) else np.float32(0)


@lean
def seed_correction(places, anchors, pixel, width, x, y):
    """What a shift changes by from the middle of a pixel to the seed (x, y) near it.

    The guide and the anchor are taken for linear there. Without this the same seed would mean
    another place in every view, by a part of a pixel.
    """
    zero = np.float32(0)
    row, column = pixel // width, pixel % width
    last = places.size // 2 - 1
    right = pixel + 1 if column + 1 < width else pixel
    below = min(pixel + width, last) if row * width + width <= last else pixel
    ux, uy = _slope(anchors, pixel, right, 0), _slope(anchors, pixel, right, 1)
    vx, vy = _slope(anchors, pixel, below, 0), _slope(anchors, pixel, below, 1)
    area = ux * vy - uy * vx
    if abs(area) < np.float32(0.05):
        return zero, zero
    ox, oy = x - anchors[2 * pixel], y - anchors[2 * pixel + 1]
    along, down = (ox * vy - oy * vx) / area, (oy * ux - ox * uy) / area
    # Further off the guide is no longer linear: the seed lies beside the surface that is seen.
    if abs(along) > np.float32(2) or abs(down) > np.float32(2):
        return zero, zero
    gx = along * _slope(places, pixel, right, 0) + down * _slope(places, pixel, below, 0) - ox
    gy = along * _slope(places, pixel, right, 1) + down * _slope(places, pixel, below, 1) - oy
    most = np.float32(2)
    return (zero, zero) if abs(gx) > most or abs(gy) > most else (gx, gy)


@numba.njit(cache=True, inline="always")
def _nearest(x, y, share, first, sites):
    """Row and column of the site nearest to (x, y)."""
    i, j = np.int64(np.floor(x * share)) - first[0], np.int64(np.floor(y * share)) - first[1]
    best, row, column = np.float32(np.inf), np.int64(0), np.int64(0)
    for v in range(max(j - 1, 0), min(j + 2, sites.shape[0])):
        for u in range(max(i - 1, 0), min(i + 2, sites.shape[1])):
            dx, dy = x - sites[v, u, 0], y - sites[v, u, 1]
            distance = dx * dx + dy * dy
            if distance < best:
                best, row, column = distance, v, u
    return row, column


@shared("places")
@lean_kernel
def nearest_sites(since, until, places, side, first, sites, out):
    """Flat number of the site nearest to each of ``places`` [N, 2], into ``out`` int32 [N].

    ``sites`` float32 [Y, X, 2] are those of the cells ``first`` + (i, j), of ``side`` each.
    """
    share = np.float32(1) / np.float32(side)
    for n in range(since, until):
        row, column = _nearest(places[n, 0], places[n, 1], share, first, sites)
        out[n] = row * sites.shape[1] + column
