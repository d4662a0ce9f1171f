"""Hot loops that turn chunk shifts into colours: election of shifts, votes, blending.

A shift is compared by the bits of its two floats, packed into one integer. Both filters first count
for a whole row how many neighbours share the middle's shift: inside a chunk that is all of them,
and nothing is left to do.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["blend", "elect", "vote"]


@numba.njit(cache=True, inline="always")
def _count_alike(packed, y, radius, counts):
    """How many pixels of each window of row ``y`` have the middle's value, for whole windows."""
    inner = packed.shape[1] - 2 * radius
    if inner <= 0:
        return
    # Slices start at zero, so that the innermost loop needs no checks and vectorises.
    middle, count = packed[y, radius:radius + inner], counts[radius:radius + inner]
    for v in range(y - radius, y + radius + 1):
        for u in range(2 * radius + 1):
            other = packed[v, u:u + inner]
            for x in range(inner):
                count[x] += np.int64(other[x] == middle[x])


@numba.njit(cache=True, parallel=True)
def elect(packed, nothing, radius, out):
    """Mode filter: the most frequent shift of each window of side 2 radius + 1, into ``out``.

    ``packed`` int64 [H, W], ``nothing`` the value of pixels without a shift. The centre's shift
    stays unless another one has more votes; the first in scan order wins among equals.
    """
    height, width = packed.shape
    whole = (2 * radius + 1) ** 2
    for y in numba.prange(height):
        counts = np.zeros(width, np.int64)
        if radius <= y < height - radius:
            _count_alike(packed, y, radius, counts)
        for x in range(width):
            own = packed[y, x]
            out[y, x] = own
            if own == nothing or 2 * counts[x] >= whole:
                continue
            top, bottom = max(y - radius, 0), min(y + radius + 1, height)
            left, right = max(x - radius, 0), min(x + radius + 1, width)
            most = 0
            for v in range(top, bottom):
                for u in range(left, right):
                    most += packed[v, u] == own
            if 2 * most >= (bottom - top) * (right - left):
                continue
            for v in range(top, bottom):
                for u in range(left, right):
                    candidate = packed[v, u]
                    if candidate in (own, nothing):
                        continue
                    votes = 0
                    for j in range(top, bottom):
                        for i in range(left, right):
                            votes += packed[j, i] == candidate
                    if votes > most:
                        most = votes
                        out[y, x] = candidate


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
def vote(picture, anchor, shift, packed, radius, exact, out):
    """Mean of the colours that the window's shifts vote for, into ``out`` [H, W, 3] float32.

    ``packed`` is ``shift`` [H, W, 2] as int64 [H, W]. Pixels without a shift (NaN) stay 0.
    ``exact`` reads whole pixels, else bilinearly.
    """
    height, width = packed.shape
    whole = (2 * radius + 1) ** 2
    for y in numba.prange(height):
        counts = np.zeros(width, np.int64)
        if radius <= y < height - radius:
            _count_alike(packed, y, radius, counts)
        for x in range(width):
            ax, ay = anchor[y, x, 0], anchor[y, x, 1]
            sx, sy = shift[y, x, 0], shift[y, x, 1]
            if not np.isfinite(sx):
                out[y, x, 0] = out[y, x, 1] = out[y, x, 2] = 0
                continue
            own_r, own_g, own_b = _sample(picture, ax + sx, ay + sy, exact)
            if counts[x] == whole:
                out[y, x, 0], out[y, x, 1], out[y, x, 2] = own_r, own_g, own_b
                continue
            red, green, blue, count = own_r, own_g, own_b, 1
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    tx, ty = shift[v, u, 0], shift[v, u, 1]
                    if (u == x and v == y) or not np.isfinite(tx):
                        continue
                    r, g, b = own_r, own_g, own_b
                    if packed[v, u] != packed[y, x]:
                        r, g, b = _sample(picture, ax + tx, ay + ty, exact)
                    red, green, blue, count = red + r, green + g, blue + b, count + 1
            share = np.float32(1) / np.float32(count)
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = red * share, green * share, blue * share


@numba.njit(cache=True, parallel=True)
def blend(photo, scale, painted, cover, out):
    """``photo`` times ``scale``, covered by ``painted`` where ``cover`` [H, W] is 1; float32."""
    height, width = cover.shape
    for y in numba.prange(height):
        for x in range(width):
            share = cover[y, x]
            for c in range(3):
                base = np.float32(photo[y, x, c]) * scale
                out[y, x, c] = base + share * (painted[y, x, c] - base)
