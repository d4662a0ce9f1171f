"""Hot loops of the exact search for the nearest patch of a picture (`evaluate.patches`).

A patch is known by a few numbers (its main components, and the length of what they leave out); the
distance of these is never more than the distance of the patches. So a tree over the short vectors
rules out nearly all patches, and the rest is compared pixel by pixel.
"""

from __future__ import annotations

import numba
import numpy as np

from lfportrait.simd.decorators import kernel, lean
from lfportrait.simd.threads import shared
from lfportrait.simd.vectors import LANES

_DEEPEST = 64
_floats, _where, _iota, _load = LANES.floats, LANES.where, LANES.iota, LANES.load
_maximum, _total = LANES.maximum, LANES.total


@numba.njit(cache=True, inline="always")
def _outside(point, low, high, node):
    """Squared distance of a short vector from a node's box."""
    zero = np.float32(0)
    below, above = _load(low, 16 * node) - point, point - _load(high, 16 * node)
    gap = _maximum(_maximum(below, above), zero)
    return _total(gap * gap)


@numba.njit(cache=True, inline="always")
def _patch_distance(one, first, pitch, two, other, other_pitch, side, most):
    """Squared distance of two patches of ``side`` rows, or more than ``most`` where it exceeds it.

    ``one`` and ``two`` are flat pictures of three channels with 16 values more at the end,
    ``first`` and ``other`` the flat numbers of the patches' first values, ``pitch`` and
    ``other_pitch`` the values in a row.
    """
    total = np.float32(0)
    for row in range(side):
        a, b = first + row * pitch, other + row * other_pitch
        line = _floats(np.float32(0))
        for n in range(0, 3 * side, 16):
            step = _load(one, a + n) - _load(two, b + n)
            step = _where(_iota() < np.int32(3 * side - n), step, np.float32(0))
            line += step * step
        total += _total(line)
        if total > most:
            break
    return total


@lean
def _search(points, query, image, first, pitch, source, source_pitch, source_columns, side, keys,
            order, leaf, low, high, stack, bounds, best, found):
    """The nearest patch to one patch: squared distance and number, from ``best`` and ``found``."""
    leaves, point = leaf.shape[0] - 1, _load(points, 16 * query)
    depth = 1
    stack[0], bounds[0] = 1, _outside(point, low, high, 1)
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if bounds[depth] >= best:
            continue
        if node >= leaves:
            for n in range(leaf[node - leaves], leaf[node - leaves + 1]):
                step = _load(keys, 16 * n) - point
                if _total(step * step) >= best:
                    continue
                place = order[n]
                other = ((place // source_columns) * source_pitch + 3 * (place % source_columns))
                distance = _patch_distance(image, first, pitch, source, other, source_pitch, side,
                                           best)
                if distance < best:
                    best, found = distance, place
            continue
        left, right = 2 * node, 2 * node + 1
        near, far = _outside(point, low, high, left), _outside(point, low, high, right)
        if near > far:
            left, right, near, far = right, left, far, near
        # The last one in is the first one looked at.
        if far < best:
            stack[depth], bounds[depth] = right, far
            depth += 1
        if near < best:
            stack[depth], bounds[depth] = left, near
            depth += 1
    return best, found


@shared("rows")
@kernel
def nearest_patches(since, until, image, width, rows, columns, points, source, source_width,
                    source_height, side, keys, order, leaf, low, high, out):
    """Squared distances of patches of a picture to their nearest of another one, into ``out`` [Q].

    Parameters
    ----------
    image, source : float32, pictures [H, W, 3] and [h, w, 3], flat, and 16 values more.
    width, source_width, source_height : W, w and h.
    rows, columns : int64 [Q], first pixels of the patches; neighbours one after the other.
    points : float32 [Q * 16], the patches' short vectors.
    side : Side of a patch in pixels.
    keys, order : float32 [N * 16] and int64 [N], short vectors and numbers (y * (w - side + 1) +
        x) of all patches of ``source``, in the order of the tree's leaves.
    leaf : int64 [L + 1], the first patch of each leaf; L is a power of two.
    low, high : float32 [2 L * 16], boxes of the tree's nodes: node n has the children 2 n and 2
        n + 1, the root is 1, the leaves are L .. 2 L - 1.
    """
    pitch, source_pitch = 3 * width, 3 * source_width
    across, down = source_width - side + 1, source_height - side + 1
    stack, bounds = np.empty(_DEEPEST, np.int64), np.empty(_DEEPEST, np.float32)
    found, last = np.int64(0), np.int64(-1)
    for q in range(since, until):
        first = rows[q] * pitch + 3 * columns[q]
        # What lies beside the last one's find is often as good.
        y, x = found // across, found % across
        if last >= 0:
            y = min(max(y + rows[q] - rows[last], 0), down - 1)
            x = min(max(x + columns[q] - columns[last], 0), across - 1)
        found, last = y * across + x, q
        best = _patch_distance(image, first, pitch, source, y * source_pitch + 3 * x,
                               source_pitch, side, np.float32(np.inf))
        out[q], found = _search(points, q, image, first, pitch, source, source_pitch, across, side,
                                keys, order, leaf, low, high, stack, bounds, best, found)
