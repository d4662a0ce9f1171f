"""Hot loops of the atlas of a skin: normals, which chart owns a point, and places in the atlas.

A chart is a far camera's picture of a head. Cameras come as rows of sixteen numbers
(`Camera.row`): pose row by row, focal lengths, principal point. Charts lie side by side in
one atlas, so a chart's pixel (x, y) is the atlas' (x + dx, y + dy); depths are the atlas', infinite
where a chart shows no surface.
"""

import numpy as np
from numba import njit

from ...simd.decorators import kernel, lean, lean_kernel
from ...simd.threads import shared

_NOWHERE = -1


@shared("points")
@kernel
def surface_normals(since, until, points, limit, out):
    """Unit normals, towards the viewer, of surface points [H, W, 3], into out float32 [H, W, 3].

    ``limit`` is the longest step to a neighbour that counts. A pixel without a point, or without a
    neighbour across or below, gets NaN.
    """
    height, width = points.shape[:2]
    for y in range(since, until):
        step = np.empty((2, 3), np.float64)
        for x in range(width):
            for k in range(3):
                out[y, x, k] = np.nan
            if not np.isfinite(points[y, x, 0]):
                continue
            known = 0
            for axis in range(2):
                count = 0
                for k in range(3):
                    step[axis, k] = 0.0
                for sign in (-1, 1):
                    j = y + sign if axis == 1 else y
                    i = x + sign if axis == 0 else x
                    if j < 0 or j >= height or i < 0 or i >= width:
                        continue
                    length = 0.0
                    for k in range(3):
                        length += (points[j, i, k] - points[y, x, k]) ** 2
                    # A comparison with NaN is false.
                    if length < limit * limit:
                        count += 1
                        for k in range(3):
                            step[axis, k] += sign * (points[j, i, k] - points[y, x, k])
                known += count > 0
            if known < 2:
                continue
            a, b = step[0], step[1]
            # Down times across points towards the viewer.
            nx = b[1] * a[2] - b[2] * a[1]
            ny = b[2] * a[0] - b[0] * a[2]
            nz = b[0] * a[1] - b[1] * a[0]
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            if length > 0:
                out[y, x, 0], out[y, x, 1], out[y, x, 2] = nx / length, ny / length, nz / length


@lean_kernel
def sum_normals(points, normals, low, cell, sums):
    """Add the normals [H, W, 3] to the cells of side ``cell`` of a grid float32 [Z, Y, X, 3]."""
    for y in range(points.shape[0]):
        for x in range(points.shape[1]):
            if np.isfinite(normals[y, x, 0]):
                i = int(np.floor((points[y, x, 0] - low[0]) / cell))
                j = int(np.floor((points[y, x, 1] - low[1]) / cell))
                k = int(np.floor((points[y, x, 2] - low[2]) / cell))
                if (0 <= i < sums.shape[2] and 0 <= j < sums.shape[1] and 0 <= k < sums.shape[0]):
                    for axis in range(3):
                        sums[k, j, i, axis] += normals[y, x, axis]


@lean
def _between(grid, low, cell, x, y, z, out):
    """Trilinear value of a grid [Z, Y, X, 3], held by its cells' middles, at unit length."""
    fx = min(max((x - low[0]) / cell - 0.5, 0.0), grid.shape[2] - 1.001)
    fy = min(max((y - low[1]) / cell - 0.5, 0.0), grid.shape[1] - 1.001)
    fz = min(max((z - low[2]) / cell - 0.5, 0.0), grid.shape[0] - 1.001)
    i, j, k = int(fx), int(fy), int(fz)
    fx, fy, fz = fx - i, fy - j, fz - k
    length = 0.0
    for axis in range(3):
        value = 0.0
        for c in range(2):
            for b in range(2):
                for a in range(2):
                    value += ((fx if a else 1 - fx) * (fy if b else 1 - fy)
                              * (fz if c else 1 - fz) * grid[k + c, j + b, i + a, axis])
        out[axis] = value
        length += value * value
    length = np.sqrt(length)
    for axis in range(3):
        out[axis] = out[axis] / length if length > 1e-9 else (1.0 if axis == 2 else 0.0)


@shared("points")
@kernel
def smooth_normals(since, until, points, grid, low, cell, out):
    """Normals of the large shape at points [N, 3], into out float32 [N, 3]; see `_between`."""
    for n in range(since, until):
        value = np.empty(3, np.float64)
        _between(grid, low, cell, points[n, 0], points[n, 1], points[n, 2], value)
        for axis in range(3):
            out[n, axis] = value[axis]


@njit(cache=True, nogil=True, inline="always")
def _project(camera, x, y, z):
    """Place in a camera's picture, and depth along its axis."""
    dx, dy, dz = x - camera[3], y - camera[7], z - camera[11]
    a = camera[0] * dx + camera[4] * dy + camera[8] * dz
    b = camera[1] * dx + camera[5] * dy + camera[9] * dz
    c = camera[2] * dx + camera[6] * dy + camera[10] * dz
    return a / c * camera[12] + camera[14], b / c * camera[13] + camera[15], c


@njit(cache=True, nogil=True, inline="always")
def _towards(camera, x, y, z, normal):
    """Cosine between a normal and the direction to a camera."""
    dx, dy, dz = camera[3] - x, camera[7] - y, camera[11] - z
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    return (dx * normal[0] + dy * normal[1] + dz * normal[2]) / length


@lean
def _find(x, y, z, normal, cameras, bias, boxes, depths, before, behind, out):
    """Best chart of a point, its place in the atlas into out [2], and how far behind it lies.

    ``boxes`` int64 [C, 6]: a chart's columns and rows (x0, y0, x1, y1) that the atlas holds, and
    where in the atlas its pixel (0, 0) lies.
    """
    best, best_score, best_away = -1, -1e9, 0.0
    for chart in range(len(cameras)):
        facing = _towards(cameras[chart], x, y, z, normal)
        if facing + bias[chart] <= best_score:
            continue
        u, v, depth = _project(cameras[chart], x, y, z)
        i, j = int(np.floor(u)), int(np.floor(v))
        if (i < boxes[chart, 0] or j < boxes[chart, 1] or i >= boxes[chart, 2]
                or j >= boxes[chart, 3]):
            continue
        away = depth - depths[j + boxes[chart, 5], i + boxes[chart, 4]]
        if not (-before <= away <= behind):
            continue
        best, best_score, best_away = chart, facing + bias[chart], away
        out[0], out[1] = u + boxes[chart, 4], v + boxes[chart, 5]
    return best, best_away


@shared("points")
@kernel
def find_owners(since, until, points, grid, low, cell, own, cameras, bias, boxes, depths, tolerance,
                owner):
    """Pixel of the atlas that owns each pixel's surface point, int32 [H, W]; -1 without a point.

    Parameters
    ----------
    points : float32 [H, W, 3] of the atlas.
    grid, low, cell : Normals of the large shape, see `_between`.
    own : int8 [H, W], the chart that a pixel lies in.
    cameras, bias, boxes, depths : Of the charts, see `_find`; ``bias`` is added to the cosine of a
        chart.
    tolerance : Depths that differ by less are the same surface.
    """
    width = own.shape[1]
    for row in range(since, until):
        place, normal = np.empty(2, np.float64), np.empty(3, np.float64)
        for column in range(width):
            owner[row, column] = _NOWHERE
            x, y, z = points[row, column, 0], points[row, column, 1], points[row, column, 2]
            if not np.isfinite(x):
                continue
            _between(grid, low, cell, x, y, z, normal)
            chart, _ = _find(x, y, z, normal, cameras, bias, boxes, depths, tolerance, tolerance,
                             place)
            if chart < 0 or chart == own[row, column]:
                owner[row, column] = row * width + column
            else:
                owner[row, column] = int(place[1]) * width + int(place[0])


@shared("points")
@kernel
def locate(since, until, points, grid, low, cell, cameras, bias, boxes, depths, before, behind,
           places, depth):
    """Places of points [N, 3] in the atlas, float32 [N, 2]; NaN where no chart shows them.

    A point up to ``before`` in front of a chart's surface and up to ``behind`` under it belongs to
    it. Below the surface the place is that of the point brought up along the large shape's normal.
    ``depth`` float32 [N] is filled with how far under the surface a point lies.
    """
    for n in range(since, until):
        place, normal = np.empty(2, np.float64), np.empty(3, np.float64)
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        _between(grid, low, cell, x, y, z, normal)
        places[n, 0] = places[n, 1] = np.nan
        depth[n] = np.nan
        chart, away = _find(x, y, z, normal, cameras, bias, boxes, depths, before, behind, place)
        if chart < 0:
            continue
        # Along the normal it is nearer to the surface than along the chart's axis.
        facing = max(_towards(cameras[chart], x, y, z, normal), 0.0)
        lift = away * facing
        x, y, z = x + lift * normal[0], y + lift * normal[1], z + lift * normal[2]
        u, v, _ = _project(cameras[chart], x, y, z)
        i, j = int(np.floor(u)), int(np.floor(v))
        if (boxes[chart, 0] <= i < boxes[chart, 2] and boxes[chart, 1] <= j < boxes[chart, 3]
                and np.isfinite(depths[j + boxes[chart, 5], i + boxes[chart, 4]])):
            place[0], place[1] = u + boxes[chart, 4], v + boxes[chart, 5]
        places[n, 0], places[n, 1] = place[0], place[1]
        depth[n] = lift


@shared("depth")
@lean_kernel
def lift_points(since, until, depth, camera, out):
    """World points at depths [H, W] along a camera's axis, into out float32 [H, W, 3].

    NaN where the depth is infinite.
    """
    width = depth.shape[1]
    for row in range(since, until):
        for column in range(width):
            far = depth[row, column]
            if not np.isfinite(far):
                for axis in range(3):
                    out[row, column, axis] = np.nan
                continue
            x = (column + 0.5 - camera[14]) / camera[12] * far
            y = (row + 0.5 - camera[15]) / camera[13] * far
            for axis in range(3):
                k = 4 * axis
                out[row, column, axis] = (camera[k] * x + camera[k + 1] * y + camera[k + 2] * far
                                          + camera[k + 3])


@shared("points")
@lean_kernel
def best_facing(since, until, points, normals, positions, out):
    """Largest cosine between normals [N, 3] at points [N, 3] and directions to positions [P, 3]."""
    for n in range(since, until):
        best = -1.0
        for p in range(len(positions)):
            dx = positions[p, 0] - points[n, 0]
            dy = positions[p, 1] - points[n, 1]
            dz = positions[p, 2] - points[n, 2]
            dot = dx * normals[n, 0] + dy * normals[n, 1] + dz * normals[n, 2]
            best = max(best, dot / np.sqrt(dx * dx + dy * dy + dz * dz))
        out[n] = best


@shared("owner")
@lean_kernel
def fringe(since, until, owner, margin, out):
    """Owners for pixels that have none, within ``margin``: of the nearest in the row, else column.

    ``out`` int32 [H, W] comes as a copy of ``owner``.
    """
    height, width = owner.shape
    for y in range(since, until):
        for x in range(width):
            if owner[y, x] >= 0:
                continue
            for away in range(1, margin + 1):
                if x >= away and owner[y, x - away] >= 0:
                    out[y, x] = owner[y, x - away]
                elif x + away < width and owner[y, x + away] >= 0:
                    out[y, x] = owner[y, x + away]
                elif y >= away and owner[y - away, x] >= 0:
                    out[y, x] = owner[y - away, x]
                elif y + away < height and owner[y + away, x] >= 0:
                    out[y, x] = owner[y + away, x]
                else:
                    continue
                break


@shared("owner")
@lean_kernel
def exchange(since, until, owner, values):
    """Give pixels of values [H, W, C] that others own their owner's value.

    Owners own themselves, so the order does not matter.
    """
    width = owner.shape[1]
    for row in range(since, until):
        for column in range(width):
            place = owner[row, column]
            if place >= 0 and place != row * width + column:
                j, i = place // width, place % width
                for channel in range(values.shape[2]):
                    values[row, column, channel] = values[j, i, channel]


@shared("places")
@lean_kernel
def look_up_colors(since, until, colors, places, out):
    """Bilinear colors [H, W, 3] at places [N, 2] (NaN: left), into out float32 [N, 3]."""
    height, width = colors.shape[:2]
    for n in range(since, until):
        if not np.isfinite(places[n, 0]):
            continue
        x, y = places[n, 0] - np.float32(0.5), places[n, 1] - np.float32(0.5)
        i = min(max(int(np.floor(x)), 0), width - 2)
        j = min(max(int(np.floor(y)), 0), height - 2)
        fx = min(max(x - np.float32(i), np.float32(0)), np.float32(1))
        fy = min(max(y - np.float32(j), np.float32(0)), np.float32(1))
        for channel in range(3):
            top = colors[j, i, channel] + fx * (colors[j, i + 1, channel] - colors[j, i, channel])
            low = colors[j + 1, i, channel] + fx * (colors[j + 1, i + 1, channel]
                                                    - colors[j + 1, i, channel])
            out[n, channel] = top + fy * (low - top)


@shared("slots")
@lean_kernel
def spread(since, until, values, slots, empty, out):
    """Rows of values [N, C] at the pixels whose slots [H, W] name them, into out [H, W, C].

    Pixels without a slot (-1) are ``empty``.
    """
    width = slots.shape[1]
    for row in range(since, until):
        for column in range(width):
            slot = slots[row, column]
            for channel in range(values.shape[1]):
                out[row, column, channel] = values[slot, channel] if slot >= 0 else empty


@shared("places")
@lean_kernel
def sample_nodes(since, until, nodes, low, spacing, places, out):
    """Bilinear values of nodes [h, w, C] at places [N, 2], into out [N, C].

    Node (0, 0) lies at ``low``, the others ``spacing`` apart; beyond them the border's values hold.
    """
    height, width, channels = nodes.shape
    for n in range(since, until):
        x = min(max((places[n, 0] - low[0]) / spacing, 0.0), width - 1.0)
        y = min(max((places[n, 1] - low[1]) / spacing, 0.0), height - 1.0)
        i, j = min(int(x), width - 2), min(int(y), height - 2)
        fx, fy = np.float32(x - i), np.float32(y - j)
        for channel in range(channels):
            top = nodes[j, i, channel] + fx * (nodes[j, i + 1, channel] - nodes[j, i, channel])
            below = nodes[j + 1, i, channel] + fx * (nodes[j + 1, i + 1, channel]
                                                     - nodes[j + 1, i, channel])
            out[n, channel] = top + fy * (below - top)
