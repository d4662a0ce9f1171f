"""Hot loops of the seeds of StyleBlit (Sykora et al. 2019): a jittered grid for every level.

Seeds lie in the anchor plane. Cells of all levels stand one after the other in flat arrays; each
level has a border of empty cells, and an empty cell's seed lies at infinity, so that the search for
the nearest seed needs no bounds.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["finite_range", "seed_correction", "seed_points", "seed_regular", "seed_splat"]

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


@numba.njit(cache=True, nogil=True)
def _jitter(seed, level, i, j, axis):
    """Uniform number in [0, 1) that depends on the counters alone."""
    key = _mix(np.uint64(seed) * _K1 + np.uint64(level * 2 + axis))
    key = _mix(key ^ (np.uint64(i) * _K2))
    key = _mix(key ^ (np.uint64(j) * _K3))
    return np.float32(np.float64(key >> _S40) / 16777216.0)


@numba.njit(cache=True, nogil=True)
def seed_points(seed, level, first_x, first_y, points):
    """Jittered seeds of the cells (first_x + i, first_y + j), side 2^level, into [Y, X, 2]."""
    side = np.float32(1 << level)
    for j in range(points.shape[0]):
        for i in range(points.shape[1]):
            x, y = np.int64(first_x + i), np.int64(first_y + j)
            points[j, i, 0] = side * (np.float32(x) + _jitter(seed, level, x, y, 0))
            points[j, i, 1] = side * (np.float32(y) + _jitter(seed, level, x, y, 1))


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
def _splat_finest(anchor, share, first_x, first_y, start, rows, columns, points, pixels):
    """Pixel nearest to each seed of the finest level among those in its cell.

    ``share`` is one over the cells' side. The first in scan order wins among equals.
    """
    best = np.full(rows * columns, np.inf, np.float32)
    for y in range(anchor.shape[0]):
        for x in range(anchor.shape[1]):
            ax, ay = anchor[y, x, 0], anchor[y, x, 1]
            if not np.isfinite(ax):
                continue
            n = ((np.int64(np.floor(ay * share)) - first_y) * columns
                 + np.int64(np.floor(ax * share)) - first_x)
            dx, dy = ax - points[start + n, 0], ay - points[start + n, 1]
            distance = dx * dx + dy * dy
            if distance < best[n]:
                best[n] = distance
                pixels[start + n] = y * anchor.shape[1] + x


@numba.njit(cache=True, nogil=True)
def _nearest_of_finest(anchors, x, y, reach, share, first_x, first_y, start, rows, columns, pixels):
    """The pixel nearest to (x, y) among those that stand for the finest cells around it.

    Rings of cells are searched until one holds a pixel, at the most ``reach``; -1: there is none.
    """
    middle_i = np.int64(np.floor(x * share)) - first_x
    middle_j = np.int64(np.floor(y * share)) - first_y
    found, best = np.int32(-1), np.float32(np.inf)
    for ring in range(1, reach + 1):
        for j in range(max(middle_j - ring, 0), min(middle_j + ring + 1, rows)):
            # Within the first ring all nine, then the border alone.
            edge = ring == 1 or abs(j - middle_j) == ring
            step = 1 if edge else 2 * ring
            for i in range(middle_i - ring, middle_i + ring + 1, step):
                if not 0 <= i < columns:
                    continue
                pixel = pixels[start + j * columns + i]
                if pixel >= 0:
                    dx, dy = anchors[pixel, 0] - x, anchors[pixel, 1] - y
                    distance = dx * dx + dy * dy
                    if distance < best:
                        best, found = distance, pixel
        if found >= 0:
            break
    return found


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True, parallel=True)
def seed_splat(anchor, firsts, starts, shapes, finest, points, pixels):
    """Pixel whose anchor is near each seed; -1 where there is none.

    On the finest level it is the nearest one in the seed's cell. On the levels above it is the
    nearest of those pixels: at most one of the finest cells further off than the nearest of all,
    and like that one it depends on the anchors alone. Seeds without a pixel move to infinity.
    """
    height, width = anchor.shape[0], anchor.shape[1]
    anchors = anchor.reshape(height * width, 2)
    begin, rows, columns = starts[finest], shapes[finest, 0], shapes[finest, 1]
    first_x, first_y = firsts[finest, 0], firsts[finest, 1]
    share = np.float32(1) / np.float32(1 << finest)
    _splat_finest(anchor, share, first_x, first_y, begin, rows, columns, points, pixels)
    for level in range(finest + 1, starts.shape[0]):
        reach = min(1 << (level - finest), 3)
        for j in numba.prange(shapes[level, 0]):
            for i in range(shapes[level, 1]):
                n = starts[level] + j * shapes[level, 1] + i
                near = _nearest_of_finest(anchors, points[n, 0], points[n, 1], reach, share,
                                          first_x, first_y, begin, rows, columns, pixels)
                if near >= 0:
                    near = _walk(anchors, width, near, points[n, 0], points[n, 1])
                pixels[n] = near
    for n in range(points.shape[0]):
        if pixels[n] < 0:
            points[n, 0] = points[n, 1] = np.float32(np.inf)


@numba.njit(cache=True, nogil=True, parallel=True)
def finite_range(values, low, high):
    """Least and largest finite value of every row: ``values`` [H, W, 2] into [H, 2] each."""
    for y in numba.prange(values.shape[0]):
        for c in range(2):
            least, most = np.float32(np.inf), np.float32(-np.inf)
            for x in range(values.shape[1]):
                value = values[y, x, c]
                if np.isfinite(value):
                    least, most = min(least, value), max(most, value)
            low[y, c], high[y, c] = least, most


@numba.njit(cache=True, inline="always")
def _slope(values, pixel, other, c):
    """Change of a component of pairs from ``pixel`` to ``other``; 0 where one of them is NaN."""
    step = values[2 * other + c] - values[2 * pixel + c]
    return step if np.isfinite(step) else np.float32(0)


@numba.njit(cache=True)
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
