"""Hot loops of the outline matching: signed distances by sweeps, and shifts along them."""

from __future__ import annotations

import numba
import numpy as np

from ...simd.decorators import lean_kernel
from ...simd.threads import shared

__all__ = ["distances", "edge_distances", "snap", "sweep_distances"]


@lean_kernel
def edge_distances(mask, far, out):
    """Signed distances (positive inside) of the cells next to the edge of ``mask`` [h, w].

    The edge is where the mask, bilinear between cells, is one half; ``out`` [h, w] float32 gets
    distances in cells, and +-``far`` elsewhere.
    """
    height, width = mask.shape
    half = np.float32(0.5)
    for y in range(height):
        for x in range(width):
            own = mask[y, x] - half
            inverse = np.float32(0)
            for axis in range(2):
                nearest = np.float32(2)
                for step in (-1, 1):
                    v, u = (y + step, x) if axis == 0 else (y, x + step)
                    if 0 <= v < height and 0 <= u < width:
                        other = mask[v, u] - half
                        if (own > 0) != (other > 0):
                            nearest = min(nearest, abs(own) / max(abs(own - other),
                                                                  np.float32(1e-6)))
                if nearest < 2:
                    nearest = max(nearest, np.float32(1e-3))
                    inverse += np.float32(1) / (nearest * nearest)
            length = np.float32(1) / np.sqrt(inverse) if inverse > 0 else far
            out[y, x] = length if own > 0 else -length


@numba.njit(cache=True, inline="always")
def _eikonal(a, b):
    """Distance of a cell whose nearer neighbours across and down are ``a`` and ``b`` away."""
    low, high = min(a, b), max(a, b)
    gap = high - low
    if gap >= 1:
        return low + np.float32(1)
    return np.float32(0.5) * (low + high + np.sqrt(np.float32(2) - gap * gap))


@lean_kernel
def sweep_distances(distance, far):
    """Carry signed distances [h, w] outwards in place (fast sweeping), up to +-``far`` cells."""
    height, width = distance.shape
    for turn in range(4):
        down, right = turn < 2, turn % 2 == 0
        for j in range(height):
            y = j if down else height - 1 - j
            for i in range(width):
                x = i if right else width - 1 - i
                own = distance[y, x]
                inside = own > 0
                a = b = far
                if x > 0 and (distance[y, x - 1] > 0) == inside:
                    a = min(a, abs(distance[y, x - 1]))
                if x + 1 < width and (distance[y, x + 1] > 0) == inside:
                    a = min(a, abs(distance[y, x + 1]))
                if y > 0 and (distance[y - 1, x] > 0) == inside:
                    b = min(b, abs(distance[y - 1, x]))
                if y + 1 < height and (distance[y + 1, x] > 0) == inside:
                    b = min(b, abs(distance[y + 1, x]))
                # Most cells are far from the edge, and so are their neighbours.
                if a >= far and b >= far:
                    continue
                best = min(abs(own), _eikonal(a, b))
                distance[y, x] = best if inside else -best


@shared("masks")
@lean_kernel
def distances(since, until, masks, far, out):
    """`edge_distances` and `sweep_distances` of the masks [K, h, w], a mask a thread."""
    for k in range(since, until):
        edge_distances(masks[k], far[k], out[k])
        sweep_distances(out[k], far[k])


@numba.njit(cache=True, inline="always")
def _sample(field, x, y):
    """Value and slope (per cell) of ``field`` [h, w] at the cell coordinates (x, y), inside it."""
    i, j = min(np.int64(x), field.shape[1] - 2), min(np.int64(y), field.shape[0] - 2)
    fx, fy = x - np.float32(i), y - np.float32(j)
    a, b, c, d = field[j, i], field[j, i + 1], field[j + 1, i], field[j + 1, i + 1]
    top, low = a + fx * (b - a), c + fx * (d - c)
    return top + fy * (low - top), (b - a) + fy * ((d - c) - (b - a)), low - top


@shared("nodes")
@lean_kernel
def snap(since, until, nodes, wanted, style, cell, reach, most, keep, rounds):
    """Move places so that their distance from the exemplar's edge is the wanted one, in place.

    Where edges disagree too much to be matched, a place at least stays on its side of the edge.

    Parameters
    ----------
    nodes
        float32 [h, w, 2], places in exemplar pixels.
    wanted
        float32 [h, w], signed distance from the target's edge, in exemplar pixels.
    style
        float32 [H, W], the exemplar's signed distances in pixels, one value a cell.
    cell
        Side of a cell of ``style`` in pixels.
    reach
        The move fades over this distance from the edge (Gaussian sigma).
    most
        And where the distances disagree by more than about this: other edges are meant.
    keep
        What is inside ends up inside by half the wanted distance or by this one, whichever is less,
        and what is outside likewise outside; 0 lets it lie where it does.
    rounds
        Steps towards the wanted distance.
    """
    share = np.float32(1) / np.float32(cell)
    right, bottom = np.float32(style.shape[1] - 1), np.float32(style.shape[0] - 1)
    half, zero = np.float32(0.5), np.float32(0)
    for j in range(since, until):
        for i in range(nodes.shape[1]):
            near = wanted[j, i] / reach
            weight = np.exp(-half * near * near)
            bound = min(max(half * wanted[j, i], -keep), keep)
            goal = zero
            for turn in range(rounds):
                x, y = nodes[j, i, 0] * share - half, nodes[j, i, 1] * share - half
                inside = zero <= x <= right and zero <= y <= bottom
                x, y = min(max(x, zero), right), min(max(y, zero), bottom)
                value, across, down = _sample(style, x, y)
                if turn == 0:
                    off = wanted[j, i] - value
                    first = off / most
                    goal = value
                    if inside and weight > np.float32(0.01):
                        goal += weight * np.exp(-half * first * first) * off
                    if bound > zero:
                        goal = max(goal, bound)
                    elif bound < zero:
                        goal = min(goal, bound)
                    if goal == value:
                        break
                # Where ridges of the distance meet the slope says nothing.
                slope = (across * across + down * down) * share * share
                if slope < (np.float32(0.05) if goal == bound else np.float32(0.25)):
                    break
                step = (goal - value) * share / max(slope, np.float32(0.25))
                nodes[j, i, 0] = (x + half) * np.float32(cell) + step * across
                nodes[j, i, 1] = (y + half) * np.float32(cell) + step * down
