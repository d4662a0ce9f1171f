"""Rays of a chart, marched to the surface of a field; lattice points looked up in a chart."""

from __future__ import annotations

import numpy as np

from ...simd.decorators import identified, lean, lean_kernel
from ...simd.threads import shared

__all__ = ["march_chart", "mark_between", "outside_chart", "place_points"]


@shared("origins")
@lean_kernel
def march_chart(since, until, origins, rays, distances, density, colors, links, lattice, cut,
                within, found, clear, color):
    """Light that is left along rays inwards, and where half of it is gone.

    Parameters
    ----------
    origins, rays
        float64 [N, 3] each, where rays end and unit vectors away from there, world units.
    distances
        float64 [K], falling, from there: where samples lie.
    density
        float32 [R + 1], optical depth of each row's voxel; the last one is zero.
    colors
        float64 [R + 1, 3].
    links
        int32 [Z, Y, X], row of each lattice point; -1: none.
    lattice
        float64 [2, 3], factor and offset from the world to lattice points (x, y, z).
    cut
        float64 [4], normal and height of a plane below which nothing counts.
    within
        Samples behind the half of the light after which a ray ends.
    found
        float64 [N], written where half of the light goes: the distance, between two samples.
    clear, color
        float64 [N] and [N, 3], changed: light that is left, and what was seen.
    """
    depth, height, width = links.shape
    empty = len(density) - 1
    for n in range(since, until):
        left, behind = 1.0, 0
        for k in range(len(distances)):
            x = origins[n, 0] + rays[n, 0] * distances[k]
            y = origins[n, 1] + rays[n, 1] * distances[k]
            z = origins[n, 2] + rays[n, 2] * distances[k]
            i = int(np.rint(x * lattice[0, 0] + lattice[1, 0]))
            j = int(np.rint(y * lattice[0, 1] + lattice[1, 1]))
            m = int(np.rint(z * lattice[0, 2] + lattice[1, 2]))
            row = empty
            if (0 <= i < width and 0 <= j < height and 0 <= m < depth
                    and x * cut[0] + y * cut[1] + z * cut[2] > cut[3] and links[m, j, i] >= 0):
                row = links[m, j, i]
            after = left * np.exp(-density[row])
            for channel in range(3):
                color[n, channel] += (left - after) * colors[row, channel]
            if left >= 0.5 and after < 0.5:
                part = (left - 0.5) / max(left - after, 1e-9)
                found[n] = distances[k] + (distances[0] - distances[1]) * (1.0 - part)
            left = after
            if after < 0.5:
                behind += 1
                if behind > within:
                    break
        clear[n] = left


@identified("chart axis")
@lean
def _from_axis(x, y, z, frame, axis, cell, level):
    """A point as seen from the axis: row below the brows, east, front, how far above, distance.

    In units of ``axis``; the other arguments are as for `outside_chart`.
    """
    top, last = level - 1, len(axis) - 1
    up = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z + frame[1, 3]
    height = (up - axis[0, 1]) / cell
    at = min(max(height, 0.0), float(top))
    row = min(int(at), max(top - 1, 0))
    share, following = at - row, min(row + 1, top)
    east = (frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z + frame[0, 3]
            - axis[row, 0] - share * (axis[following, 0] - axis[row, 0]))
    front = (frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z + frame[2, 3]
             - axis[row, 2] - share * (axis[following, 2] - axis[row, 2]))
    over = max(up - axis[last, 1], 0.0)
    flat = np.sqrt(east * east + front * front)
    return height, east, front, over, np.sqrt(flat * flat + over * over)


@identified("chart place")
@lean
def _place(height, east, front, over, level, step, angles):
    """Row (not bounded) and column (not around) of a point that `_from_axis` describes."""
    if over > 0.0:
        height = level - 1 + np.arctan2(over, np.sqrt(east * east + front * front)) / step
    return height, (np.arctan2(east, front) - angles[0]) / angles[1]


@shared("marks")
@lean_kernel
def mark_between(since, until, links, first, origin, spacing, frame, axis, cell, level, step,
                 angles, low, high, least, most, marks):
    """Mark empty lattice points whose distances from the chart's axis are within bounds.

    Parameters
    ----------
    links
        int32 [Z, Y, X], rows of lattice points; -1: none, an empty one.
    first
        int64 [3] (x, y, z), the lattice point of the first mark.
    origin, spacing, frame, axis, cell, level, step, angles
        As for `outside_chart`; ``origin`` is lattice point 0.
    low, high
        float64 [V, U], bounds of the points whose nearest cell it is, in units of ``axis``.
    least, most
        float64 [level], the widest bounds from a row to the next one; of the last one, from there
        on.
    marks
        bool [z, y, x], written.
    """
    rows, columns = low.shape
    for k in range(since, until):
        z = origin[2] + spacing[2] * (k + first[2])
        for j in range(marks.shape[1]):
            y = origin[1] + spacing[1] * (j + first[1])
            for i in range(marks.shape[2]):
                marks[k, j, i] = False
                if links[k + first[2], j + first[1], i + first[0]] >= 0:
                    continue
                x = origin[0] + spacing[0] * (i + first[0])
                height, east, front, over, away = _from_axis(x, y, z, frame, axis, cell, level)
                # Most points are out of all bounds: those need no angles.
                band = min(max(int(height), 0), level - 1)
                if not least[band] < away < most[band]:
                    continue
                height, column = _place(height, east, front, over, level, step, angles)
                row = min(max(int(np.rint(height)), 0), rows - 1)
                column = int(np.rint(column)) % columns
                marks[k, j, i] = low[row, column] < away < high[row, column]


@shared("points")
@lean_kernel
def place_points(since, until, points, frame, axis, cell, level, step, angles, places, away):
    """Where points are in a chart.

    Parameters
    ----------
    points
        float64 [N, 3], world units.
    frame, axis, cell, level, step, angles
        As for `outside_chart`.
    places
        float64 [2, N], written: row, and column (which may lie below 0).
    away
        float64 [N], written: distance from the axis, in its units.
    """
    for n in range(since, until):
        height, east, front, over, away[n] = _from_axis(points[n, 0], points[n, 1], points[n, 2],
                                                        frame, axis, cell, level)
        places[0, n], places[1, n] = _place(height, east, front, over, level, step, angles)


@shared("beyond")
@lean_kernel
def outside_chart(since, until, origin, spacing, scale, frame, axis, cell, level, step, angles,
                  distance, margin, beyond, clearance):
    """How far the points of a lattice lie outside of a chart's surface, along its rays.

    Parameters
    ----------
    origin, spacing
        float64 [3] each, position of lattice point 0 and their distances, world units.
    scale, frame
        Units of the chart's frame in one world unit, and float64 [3, 4], to that frame.
    axis
        float64 [V, 3], where the rays of each row end.
    cell, level, step
        Distance of rows, number of those whose rays are horizontal, and radians from one of the
        others to the next.
    angles
        float64 [2], of column 0, and from one column to the next; columns go around.
    distance, margin
        float64 [V, U] each, world units: the surface, and what is looked up beside it.
    beyond, clearance
        float32 [Z, Y, X] each, written: distance of each point from the surface, below zero inside,
        and the margin.
    """
    rows, columns = distance.shape
    for k in range(since, until):
        z = origin[2] + spacing[2] * k
        for j in range(beyond.shape[1]):
            y = origin[1] + spacing[1] * j
            for i in range(beyond.shape[2]):
                x = origin[0] + spacing[0] * i
                height, east, front, over, out = _from_axis(x, y, z, frame, axis, cell, level)
                height, column = _place(height, east, front, over, level, step, angles)
                height = min(max(height, 0.0), float(rows - 1))
                low, left = min(int(height), max(rows - 2, 0)), int(np.floor(column))
                up_share, right_share = height - low, column - left
                high, right = min(low + 1, rows - 1), (left + 1) % columns
                left %= columns
                weights = ((1.0 - up_share) * (1.0 - right_share), (1.0 - up_share) * right_share,
                           up_share * (1.0 - right_share), up_share * right_share)
                away = (weights[0] * distance[low, left] + weights[1] * distance[low, right]
                        + weights[2] * distance[high, left] + weights[3] * distance[high, right])
                beyond[k, j, i] = out / scale - away
                clearance[k, j, i] = (
                    weights[0] * margin[low, left] + weights[1] * margin[low, right]
                    + weights[2] * margin[high, left] + weights[3] * margin[high, right])
