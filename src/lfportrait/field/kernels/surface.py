"""The surface of a field, found from outside, and along the rays of a chart.

`depth_from_outside` walks through the lattice along directions whose steps lead from lattice point
to lattice point (a neighbour's offset, diagonals included), so that nothing is interpolated. The
minimum over the directions separates outside from inside, whatever the field holds behind its
surface. `march_chart` follows a chart's rays inwards until half of the light is gone.
"""

import numpy as np

from ...simd.decorators import identified, kernel, lean, lean_kernel
from ...simd.threads import shared
from .march import sh_basis


def _across_planes(density, dz, dy, dx, length, least):
    """One direction with ``dz`` = -1 or 1: plane after plane."""
    before, here = np.zeros((2, *density.shape[1:]), np.float32)
    for k in range(len(density))[::dz]:
        behind = k - dz if 0 <= k - dz < len(density) else -1
        _next_plane(density, k, behind, dy, dx, np.float32(0.5) * length, before, here, least)
        before, here = here, before


@shared("here")
@lean_kernel
def _next_plane(since, until, density, k, behind, dy, dx, half, before, here, least):
    """Depths ``here`` on plane ``k`` from those on plane ``behind`` it, -1 for the outside."""
    rows, columns = here.shape
    for j in range(since, until):
        jj = j - dy
        for i in range(columns):
            ii = i - dx
            own = density[k, j, i]
            if behind >= 0 and 0 <= jj < rows and 0 <= ii < columns:
                value = before[jj, ii] + half * (own + density[behind, jj, ii])
            else:
                value = half * own
            here[j, i] = value
            least[k, j, i] = min(least[k, j, i], value)


@shared("density")
@kernel
def _inside_planes(since, until, density, dy, dx, length, least):
    """One direction within the planes of constant z."""
    rows, columns = density.shape[1:]
    half = np.float32(0.5) * length
    for k in range(since, until):
        before = np.zeros(columns, np.float32)
        here = np.zeros(columns, np.float32)
        for number in range(rows):
            j = rows - 1 - number if dy < 0 else number
            jj = j - dy
            for count in range(columns):
                i = columns - 1 - count if dx < 0 else count
                ii = i - dx
                value = half * density[k, j, i]
                if 0 <= jj < rows and 0 <= ii < columns:
                    value += half * density[k, jj, ii]
                    value += here[ii] if dy == 0 else before[ii]
                here[i] = value
                if value < least[k, j, i]:
                    least[k, j, i] = value
            before, here = here, before


def depth_from_outside(density, spacing, directions):
    """Optical depth between each lattice point and the outside, along the best direction.

    Parameters
    ----------
    density : float32 [Z, Y, X], per world unit; linear between lattice points, zero beyond them.
    spacing : float [3], distance of lattice points along z, y, x in world units.
    directions : int [D, 3], steps (z, y, x) of -1, 0 or 1 in which light may come in; none all
        zero.

    Returns
    -------
    depth : float32 [Z, Y, X]; light that comes in is dimmed by exp(-depth).
    """
    least = np.full(density.shape, np.inf, np.float32)
    for dz, dy, dx in np.asarray(directions, np.int64):
        length = np.float32(np.linalg.norm(np.array([dz, dy, dx]) * np.asarray(spacing)))
        if dz != 0:
            _across_planes(density, dz, dy, dx, length, least)
        else:
            _inside_planes(density, dy, dx, length, least)
    return least


@shared("origins")
@identified("seen_colors")
@kernel
def seen_colors(since, until, links, density, sh, scale, offset, origins, directions, steps, step,
                color):
    """Volume-rendered color of short rays, of which each has its own direction.

    Parameters
    ----------
    links : int32 [Z, Y, X], row of each lattice point, -1 where it is empty.
    density, sh : float32 [N] and [N, 3, B].
    scale, offset : float64 [3] (x, y, z): lattice coordinate = world * scale + offset.
    origins, directions : float64 [K, 3] in the world; directions have unit length.
    steps, step : Number of samples of a ray and their distance in world units.
    color : float32 [K, 4] out: mean color of what the ray meets, and its opacity.
    """
    count = sh.shape[2]
    depth, height, width = links.shape
    for ray in range(since, until):
        basis = np.empty(count, np.float32)
        sh_basis(np.float32(directions[ray, 0]), np.float32(directions[ray, 1]),
                 np.float32(directions[ray, 2]), basis, 0, count)
        through = np.float32(1.0)
        total = np.zeros(3, np.float32)
        for sample in range(steps):
            along = (sample + 0.5) * step
            x = (origins[ray, 0] + along * directions[ray, 0]) * scale[0] + offset[0]
            y = (origins[ray, 1] + along * directions[ray, 1]) * scale[1] + offset[1]
            z = (origins[ray, 2] + along * directions[ray, 2]) * scale[2] + offset[2]
            if not (0.0 <= x <= width - 1 and 0.0 <= y <= height - 1 and 0.0 <= z <= depth - 1):
                continue
            i, j, k = min(int(x), width - 2), min(int(y), height - 2), min(int(z), depth - 2)
            fx, fy, fz = np.float32(x - i), np.float32(y - j), np.float32(z - k)
            sigma = np.float32(0.0)
            for corner in range(8):
                row = links[k + (corner >> 2), j + ((corner >> 1) & 1), i + (corner & 1)]
                if row >= 0:
                    sigma += (density[row] * (fx if corner & 1 else np.float32(1.0) - fx)
                              * (fy if corner & 2 else np.float32(1.0) - fy)
                              * (fz if corner & 4 else np.float32(1.0) - fz))
            if sigma <= np.float32(0.0):
                continue
            fade = np.float32(np.exp(-sigma * step))
            weight = through * (np.float32(1.0) - fade)
            through *= fade
            for channel in range(3):
                value = np.float32(0.5)
                for corner in range(8):
                    row = links[k + (corner >> 2), j + ((corner >> 1) & 1), i + (corner & 1)]
                    if row >= 0:
                        share = ((fx if corner & 1 else np.float32(1.0) - fx)
                                 * (fy if corner & 2 else np.float32(1.0) - fy)
                                 * (fz if corner & 4 else np.float32(1.0) - fz))
                        for number in range(count):
                            value += share * sh[row, channel, number] * basis[number]
                total[channel] += weight * max(value, np.float32(0.0))
        opacity = np.float32(1.0) - through
        for channel in range(3):
            color[ray, channel] = total[channel] / max(opacity, np.float32(1e-12))
        color[ray, 3] = opacity


@identified("sh_bases")
@lean_kernel
def sh_bases(directions, bases):
    """Spherical harmonics of unit directions, float64 [K, 3], into float32 [K, B]."""
    for row in range(len(directions)):
        sh_basis(np.float32(directions[row, 0]), np.float32(directions[row, 1]),
                 np.float32(directions[row, 2]), bases[row], 0, bases.shape[1])


@shared("origins")
@lean_kernel
def march_chart(since, until, origins, rays, distances, density, colors, links, lattice, cut,
                within, found, clear, color):
    """Light that is left along rays inwards, and where half of it is gone.

    Parameters
    ----------
    origins, rays : float64 [N, 3] each, where rays end and unit vectors away from there, world
        units.
    distances : float64 [K], falling, from there: where samples lie.
    density : float32 [R + 1], optical depth of each row's voxel; the last one is zero.
    colors : float64 [R + 1, 3].
    links : int32 [Z, Y, X], row of each lattice point; -1: none.
    lattice : float64 [2, 3], factor and offset from the world to lattice points (x, y, z).
    cut : float64 [4], normal and height of a plane below which nothing counts.
    within : Samples behind the half of the light after which a ray ends.
    found : float64 [N], written where half of the light goes: the distance, between two samples.
    clear, color : float64 [N] and [N, 3], changed: light that is left, and what was seen.
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
    """A point as seen from the axis: row below the brows, east, front, how far above, distance."""
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
    links : int32 [Z, Y, X], rows of lattice points; -1: none, an empty one.
    first : int64 [3] (x, y, z), the lattice point of the first mark.
    origin, spacing, frame, axis, cell, level, step, angles : As for `outside_chart`; ``origin``
        is lattice point 0.
    low, high : float64 [V, U], bounds of the points whose nearest cell it is, in units of
        ``axis``.
    least, most : float64 [level], the widest bounds from a row to the next one; of the last one,
        from there on.
    marks : bool [z, y, x], written.
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
    points : float64 [N, 3], world units.
    frame, axis, cell, level, step, angles : As for `outside_chart`.
    places : float64 [2, N], written: row, and column (which may lie below 0).
    away : float64 [N], written: distance from the axis, in its units.
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
    origin, spacing : float64 [3] each, position of lattice point 0 and their distances, world
        units.
    scale, frame : Units of the chart's frame in one world unit, and float64 [3, 4], to that
        frame.
    axis : float64 [V, 3], where the rays of each row end.
    cell, level, step : Distance of rows, number of those whose rays are horizontal, and radians
        from one of the others to the next.
    angles : float64 [2], of column 0, and from one column to the next; columns go around.
    distance, margin : float64 [V, U] each, world units: the surface, and what is looked up
        beside it.
    beyond, clearance : float32 [Z, Y, X] each, written: distance of each point from the surface,
        below zero inside, and the margin.
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
