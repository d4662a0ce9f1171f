"""Depth maps: planes that agree; votes, signed distances, outlines; pictures looked up on surfaces.

A view is a row of 16 numbers: the camera-to-world matrix [3, 4], the focal lengths and the
principal point in pixels.
"""

import numpy as np
from numba import njit

from ...simd.decorators import lean, lean_kernel
from ...simd.threads import shared
from ...simd.vectors import LANES


@njit(cache=True, inline="always")
def pixel_of(x, y, z, camera, height, width):
    """Where a camera has a point: row and column of the pixel, and distance along the optical axis.

    ``camera`` is float64 [16], pose row by row, focal, principal point. The row is -1 where the
    point lies outside the picture of ``height`` x ``width`` pixels or behind the camera.
    """
    dx, dy, dz = x - camera[3], y - camera[7], z - camera[11]
    along = camera[2] * dx + camera[6] * dy + camera[10] * dz
    if along <= 1e-6:
        return -1, -1, along
    u = (camera[0] * dx + camera[4] * dy + camera[8] * dz) / along
    v = (camera[1] * dx + camera[5] * dy + camera[9] * dz) / along
    column = int(np.floor(u * camera[12] + camera[14]))
    row = int(np.floor(v * camera[13] + camera[15]))
    if not (0 <= column < width and 0 <= row < height):
        return -1, -1, along
    return row, column, along


@shared("z")
@lean_kernel
def fuse_depth(since, until, x, y, z, camera, depth, sure, image, margin, slack, empty, solid,
               unsure, color):
    """Add one view's votes.

    Parameters
    ----------
    x, y, z : float64, coordinates of the lattice's planes in the world.
    camera : float64 [16], pose row by row, focal, principal point of the depth map.
    depth, sure, image : float32 [h, w], distance along the optical axis; bool [h, w], whether it
        was measured or only guessed; float32 [h, w, 3].
    margin, slack : Half thickness of a measured surface in world units, of a guessed one in
        parts of its depth.
    empty, solid, unsure : int16 [Z, Y, X]: views that look through the point, that see a surface
        there, that guess one there.
    color : float32 [Z, Y, X, 3], sum of the colors of those that see a surface.
    """
    height, width = depth.shape
    for k in range(since, until):
        for j in range(len(y)):
            for i in range(len(x)):
                row, column, along = pixel_of(x[i], y[j], z[k], camera, height, width)
                if row < 0:
                    continue
                there = depth[row, column]
                thick = margin if sure[row, column] else max(margin, slack * there)
                if along < there - thick:
                    empty[k, j, i] += 1
                elif along < there + thick:
                    if sure[row, column]:
                        solid[k, j, i] += 1
                        for channel in range(3):
                            color[k, j, i, channel] += image[row, column, channel]
                    else:
                        unsure[k, j, i] += 1


def fuse_distance(  # type: ignore[no-untyped-def]
        axis, cameras, depths, mattes, sizes, reach):
    """A lattice of signed distances of depth maps (Curless and Levoy 1996).

    Parameters
    ----------
    axis : float64 [N], evenly spaced coordinates of the points along each of x, y, z.
    cameras : float64 [V, 16], the views of the depth maps.
    depths, mattes : float32 [V, H, W], each in its upper left corner: distance along the optical
        axis, 0 where it is not known; how much of the pixel is the person, in [0, 1].
    sizes : int64 [V, 2], the rows and columns of each.
    reach : Distance in world units at which the measure ends: 1 in front, -1 behind the surface.

    Returns
    -------
    total, count : float32 [N, N, N] (z, y, x): the sum of the distances in parts of ``reach``,
        and over how many views. A point further behind a surface is hidden and not counted.
    person, seen : The sum of the matte over the views whose surface is within ``reach``, and how
        many these are.
    """
    size = len(axis)
    wide = (size + 15) // 16 * 16
    across = axis[0] + (axis[1] - axis[0]) * np.arange(wide)
    fused = np.empty((4, size, size, wide), np.float32)
    _fuse_rows(axis, across.astype(np.float32), cameras.astype(np.float32), depths, mattes, sizes,
               np.float32(1.0 / reach), fused[0], fused[1], fused[2], fused[3])
    return [part[..., :size] for part in fused]


_load, _store, _floats, _ints, _where = (LANES.load, LANES.store, LANES.floats, LANES.ints,
                                         LANES.where)
_bits, _gather, _minimum, _iota = LANES.bits, LANES.gather, LANES.minimum, LANES.iota
_maximum, _sqrt = LANES.maximum, LANES.sqrt
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


@shared("axis")
@lean_kernel
def _fuse_rows(since, until, axis, across, cameras, depths, mattes, sizes, inverse, total, count,
               person, seen):
    """Fill what `fuse_distance` gives, sixteen points of a row at a time."""
    wide = np.int32(depths.shape[2])
    for k in range(since, until):
        for j in range(len(axis)):
            for i in range(0, len(across), 16):
                x = _load(across, np.uintp(i))
                distance, views = _floats(_ZERO), _floats(_ZERO)
                matter, near = _floats(_ZERO), _floats(_ZERO)
                for view in range(len(cameras)):
                    camera = cameras[view]
                    dy, dz = np.float32(axis[j]) - camera[7], np.float32(axis[k]) - camera[11]
                    dx = x - camera[3]
                    along = dx * camera[2] + (camera[6] * dy + camera[10] * dz)
                    per = _ONE / along
                    column = (dx * camera[0] + (camera[4] * dy + camera[8] * dz)) * per
                    row = (dx * camera[1] + (camera[5] * dy + camera[9] * dz)) * per
                    column = column * camera[12] + camera[14]
                    row = row * camera[13] + camera[15]
                    inside = ((along > np.float32(1e-6)) & (column >= _ZERO) & (row >= _ZERO)
                              & (column < np.float32(sizes[view, 1]))
                              & (row < np.float32(sizes[view, 0])))
                    if _bits(inside) == 0:
                        continue
                    pixel = (_ints(_where(inside, row, _ZERO)) * wide
                             + _ints(_where(inside, column, _ZERO)))
                    there = _gather(depths[view], pixel)
                    ahead = (there - along) * inverse
                    counted = inside & (there > _ZERO) & (ahead >= -_ONE)
                    if _bits(counted) == 0:
                        continue
                    distance = distance + _where(counted, _minimum(ahead, _ONE), _ZERO)
                    views = views + _where(counted, _floats(_ONE), _ZERO)
                    close = counted & (ahead <= _ONE)
                    if _bits(close) != 0:
                        matter = matter + _where(close, _gather(mattes[view], pixel), _ZERO)
                        near = near + _where(close, _floats(_ONE), _ZERO)
                _store(total[k, j], np.uintp(i), distance)
                _store(count[k, j], np.uintp(i), views)
                _store(person[k, j], np.uintp(i), matter)
                _store(seen[k, j], np.uintp(i), near)


@lean_kernel
def confirm_depth(  # type: ignore[no-untyped-def]
        inverse, camera, others, inverses, sizes, slacks, confirmed):
    """Which depths of a view agree with what the map of another view has at the place.

    Parameters
    ----------
    inverse : float32 [h, w], one over the distance along the optical axis; NaN where not known.
    camera, others : float64 [16] and [K, 16].
    inverses, sizes : float32 [K, H, W] and int64 [K, 2]: the maps of the others, each in its
        upper left corner, and their rows and columns.
    slacks : float64 [K], how much the inverses may differ.
    confirmed : bool [h, w], filled.
    """
    for v in range(inverse.shape[0]):
        for u in range(inverse.shape[1]):
            confirmed[v, u] = False
            if not np.isfinite(inverse[v, u]):
                continue
            along = 1.0 / inverse[v, u]
            x = (u + 0.5 - camera[14]) / camera[12] * along
            y = (v + 0.5 - camera[15]) / camera[13] * along
            px = camera[0] * x + camera[1] * y + camera[2] * along + camera[3]
            py = camera[4] * x + camera[5] * y + camera[6] * along + camera[7]
            pz = camera[8] * x + camera[9] * y + camera[10] * along + camera[11]
            for k in range(len(others)):
                row, column, deep = pixel_of(px, py, pz, others[k], sizes[k, 0], sizes[k, 1])
                if row >= 0 and abs(inverses[k, row, column] - 1.0 / deep) < slacks[k]:
                    confirmed[v, u] = True
                    break


@njit(cache=True, inline="always")
def _between(distance, x, y, z):  # type: ignore[no-untyped-def]
    """The lattice's value at a place given in points, trilinear."""
    i, j, k = int(x), int(y), int(z)
    fx, fy, fz = x - i, y - j, z - k
    low = ((1.0 - fy) * ((1.0 - fx) * distance[k, j, i] + fx * distance[k, j, i + 1])
           + fy * ((1.0 - fx) * distance[k, j + 1, i] + fx * distance[k, j + 1, i + 1]))
    high = ((1.0 - fy) * ((1.0 - fx) * distance[k + 1, j, i] + fx * distance[k + 1, j, i + 1])
            + fy * ((1.0 - fx) * distance[k + 1, j + 1, i] + fx * distance[k + 1, j + 1, i + 1]))
    return (1.0 - fz) * low + fz * high


def outline_distance(  # type: ignore[no-untyped-def]
        distance, clear, first, spacing, camera, height, width):
    """The least signed distance along the ray of each pixel: below zero where the solid is.

    Parameters
    ----------
    distance : float32 [N, N, N] (z, y, x), 1 where space is empty.
    clear : uint8 [N, N, N], from a cell (named by its lowest corner) this many cells in every
        direction have the value 1 at all corners, 0 for a cell that has not.
    first, spacing : Coordinate of the first point along each axis, distance of the points.
    camera : float64 [16].

    Returns
    -------
    least : float32 [height, width], in (-1, 1]; a ray that is deep inside the solid ends there.
    """
    least = np.empty((height, width), np.float32)
    grid = np.empty((-(-height // _STEP) + 1, -(-width // _STEP) + 1), np.float32)
    _outline_grid(distance, clear, first, spacing, camera, grid)
    _outline_rows(distance, clear, first, spacing, camera, grid, least)
    return least


_STEP = 4  # Pixels between the rays that are followed first.


@lean
def _least_along(distance, clear, first, spacing, camera, row, column):
    """`outline_distance` along the ray of one pixel."""
    top = distance.shape[0] - 1.0
    x = (column + 0.5 - camera[14]) / camera[12]
    y = (row + 0.5 - camera[15]) / camera[13]
    ax = camera[0] * x + camera[1] * y + camera[2]
    ay = camera[4] * x + camera[5] * y + camera[6]
    az = camera[8] * x + camera[9] * y + camera[10]
    norm = np.sqrt(ax * ax + ay * ay + az * az)
    # In points, a step of one is a step of one point's distance.
    ax, ay, az = ax / norm, ay / norm, az / norm
    ox, oy = (camera[3] - first) / spacing, (camera[7] - first) / spacing
    oz = (camera[11] - first) / spacing
    start, end = 0.0, 1e9
    for origin, slope in ((ox, ax), (oy, ay), (oz, az)):
        if abs(slope) < 1e-9:
            slope = 1e-9
        one, two = -origin / slope, (top - origin) / slope
        start, end = max(start, min(one, two)), min(end, max(one, two))
    t = start + 1e-3
    best = 1.0
    while t < end - 1e-3:
        px, py, pz = ox + t * ax, oy + t * ay, oz + t * az
        free = clear[int(pz), int(py), int(px)]
        if free > 0:
            t += max(0.5, free - 1.0)
            continue
        best = min(best, _between(distance, px, py, pz))
        if best < -0.8:
            break
        t += 0.5
    return best


@shared("grid")
@lean_kernel
def _outline_grid(since, until, distance, clear, first, spacing, camera, grid):
    """The rays through the corners of blocks of pixels."""
    for row in range(since, until):
        for column in range(grid.shape[1]):
            grid[row, column] = _least_along(distance, clear, first, spacing, camera,
                                             row * _STEP, column * _STEP)


@shared("least")
@lean_kernel
def _outline_rows(since, until, distance, clear, first, spacing, camera, grid, least):
    """Fill what `outline_distance` gives.

    The rays in a block whose corners all miss the solid by far miss it, too; those between four
    that are deep inside are.
    """
    for row in range(since, until):
        upper, lower = grid[row // _STEP], grid[row // _STEP + 1]
        for column in range(least.shape[1]):
            left = column // _STEP
            a, b, c, d = upper[left], upper[left + 1], lower[left], lower[left + 1]
            if min(min(a, b), min(c, d)) >= 1.0:
                least[row, column] = 1.0
            elif max(max(a, b), max(c, d)) < -0.8:
                least[row, column] = max(max(a, b), max(c, d))
            else:
                least[row, column] = _least_along(distance, clear, first, spacing, camera, row,
                                                  column)


def compose_plate(  # type: ignore[no-untyped-def]
        inverse, wanted, camera, others, pictures, order, gains, enough, spread):
    """Colors of a surface as other views show it, as one view sees it.

    The colors of the views are averaged, each by its weight and by how well it agrees with their
    mean (two steps of reweighting by Geman and McClure's function), so that few that show
    something else do not count. Views are asked in their order until their weights are ``enough``.

    Parameters
    ----------
    inverse : float32 [h, w], one over the surface's distance along the optical axis of the view.
    wanted : uint8 [h, w], zero where nothing is to be filled.
    camera, others : float64 [16] and [K, 16]: pose row by row, focal, principal point in pixels.
    pictures : uint8 [K, H, W, 4], sRGB and the weight of each pixel: how surely it shows the
        surface.
    order : int64 [J], the views that are asked, in this order.
    gains : float32 [K, 3], by which the colors of each picture are multiplied.
    enough : Sum of weights after which no more views are asked.
    spread : Difference of colors, in [0, 1], from which on they count as different.

    Returns
    -------
    color, noise, known : float32 [h, w, 3], [h, w] and [h, w]: mean color in [0, 1], its
        standard deviation over the views (root of the channels' mean variance), and the sum of
        the weights.
    """
    height, width = inverse.shape
    color, noise, known = (np.zeros((height, width, *rest), np.float32)
                           for rest in ((3,), (), ()))
    _compose_rows(inverse, wanted, camera, others.astype(np.float32),
                  np.ascontiguousarray(pictures).view(np.int32)[..., 0], order, gains, enough,
                  spread, np.empty((height, 64 * len(order) + 80), np.float32), color, noise, known)
    return color, noise, known


@lean
def _byte(a, b, c, d, shift, right, down):
    """One byte of four words, between them, in [0, 1]."""
    mask, scale = np.int32(255), np.float32(1.0 / 255.0)
    upper = (_floats((a >> shift) & mask) * (_ONE - right)
             + _floats((b >> shift) & mask) * right)
    lower = (_floats((c >> shift) & mask) * (_ONE - right)
             + _floats((d >> shift) & mask) * right)
    return (upper * (_ONE - down) + lower * down) * scale


@shared("inverse")
@lean_kernel
def _compose_rows(since, until, inverse, wanted, camera, others, pictures, order, gains, enough,
                  spread, scratch, color, noise, known):
    """Fill what `compose_plate` gives, sixteen pixels of a row at a time.

    ``pictures`` int32 [K, H, W]; ``scratch`` float32 [h, 64 J + 80]: of each view red, green, blue
    and weight, then what comes out, for sixteen pixels each.
    """
    width = inverse.shape[1]
    high, wide = pictures.shape[1], pictures.shape[2]
    limit = spread * spread
    for y in range(since, until):
        samples = scratch[y]
        out = 64 * len(order)
        for first in range(0, width, 16):
            some = False
            for x in range(first, min(first + 16, width)):
                some |= wanted[y, x] != 0
            if not some:
                continue
            place = _minimum(_iota() + np.int32(first), np.int32(width - 1))
            along = _ONE / _maximum(_gather(inverse[y], place), np.float32(1e-6))
            u = (_floats(place) + np.float32(0.5 - camera[14])) * np.float32(1 / camera[12]) * along
            v = np.float32((y + 0.5 - camera[15]) / camera[13]) * along
            px = (u * np.float32(camera[0]) + v * np.float32(camera[1])
                  + along * np.float32(camera[2]) + np.float32(camera[3]))
            py = (u * np.float32(camera[4]) + v * np.float32(camera[5])
                  + along * np.float32(camera[6]) + np.float32(camera[7]))
            pz = (u * np.float32(camera[8]) + v * np.float32(camera[9])
                  + along * np.float32(camera[10]) + np.float32(camera[11]))
            used, weights = 0, _floats(_ZERO)
            for k in order:
                lacking = weights < enough
                if _bits(lacking) == 0:
                    break
                other = others[k]
                dx, dy, dz = px - other[3], py - other[7], pz - other[11]
                far = dx * other[2] + dy * other[6] + dz * other[10]
                per = _ONE / far
                column = (dx * other[0] + dy * other[4] + dz * other[8]) * per
                row = (dx * other[1] + dy * other[5] + dz * other[9]) * per
                column = column * other[12] + (other[14] - np.float32(0.5))
                row = row * other[13] + (other[15] - np.float32(0.5))
                inside = (lacking & (far > np.float32(1e-6)) & (column >= _ZERO) & (row >= _ZERO)
                          & (column < np.float32(wide - 1)) & (row < np.float32(high - 1)))
                if _bits(inside) == 0:
                    continue
                column, row = _where(inside, column, _ZERO), _where(inside, row, _ZERO)
                left, top = _ints(column), _ints(row)
                right, down = column - _floats(left), row - _floats(top)
                at = top * np.int32(wide) + left
                a, b = _gather(pictures[k], at), _gather(pictures[k], at + np.int32(1))
                at = at + np.int32(wide)
                c, d = _gather(pictures[k], at), _gather(pictures[k], at + np.int32(1))
                weight = _byte(a, b, c, d, np.int32(24), right, down)
                weight = _where(inside & (weight > np.float32(0.004)), weight, _ZERO)
                if _bits(weight > _ZERO) == 0:
                    continue
                for channel in range(3):
                    value = _byte(a, b, c, d, np.int32(8 * channel), right, down)
                    _store(samples, np.uintp(64 * used + 16 * channel), value * gains[k, channel])
                _store(samples, np.uintp(64 * used + 48), weight)
                weights = weights + weight
                used += 1
            red = green = blue = total = variance = _floats(_ZERO)
            for step in range(3):
                r = g = h = mass = squared = _floats(_ZERO)
                for k in range(used):
                    one = _load(samples, np.uintp(64 * k))
                    two = _load(samples, np.uintp(64 * k + 16))
                    three = _load(samples, np.uintp(64 * k + 32))
                    weight = _load(samples, np.uintp(64 * k + 48))
                    if step > 0:
                        dr, dg, db = one - red, two - green, three - blue
                        away = dr * dr + dg * dg + db * db
                        near = limit / (limit + away)
                        weight = weight * near * near
                        squared = squared + weight * away
                    r, g, h = r + weight * one, g + weight * two, h + weight * three
                    mass = mass + weight
                there = mass > _ZERO
                per = _ONE / _where(there, mass, _ONE)
                red = _where(there, r * per, red)
                green = _where(there, g * per, green)
                blue = _where(there, h * per, blue)
                variance = _where(there, squared * per * np.float32(1 / 3), variance)
                total = mass
            _store(samples, np.uintp(out), red)
            _store(samples, np.uintp(out + 16), green)
            _store(samples, np.uintp(out + 32), blue)
            _store(samples, np.uintp(out + 48), _sqrt(variance))
            _store(samples, np.uintp(out + 64), total)
            for x in range(first, min(first + 16, width)):
                if wanted[y, x] == 0:
                    continue
                at = out + x - first
                for channel in range(3):
                    color[y, x, channel] = samples[at + 16 * channel]
                noise[y, x], known[y, x] = samples[at + 48], samples[at + 64]


@lean_kernel
def places_shown(  # type: ignore[no-untyped-def]
        points, camera, nearest, farthest, before, beyond, cosines, square, outwards, least, shown):
    """Which points a view shows at depths between two maps.

    Parameters
    ----------
    points : float64 [N, 3].
    camera : float64 [16].
    nearest, farthest : float32 [h, w], distances along the optical axis.
    before, beyond : float32, how far before ``nearest`` and beyond ``farthest`` points may lie;
        below zero the first asks for nothing.
    cosines, square : float32 [h, w], of which a point's must be above ``square``, unless that is
        zero.
    outwards, least : float64 [N, 3], unit: the way to the camera has a cosine above ``least`` to
        it; [0, 3] asks for nothing.
    shown : bool [N], filled.
    """
    height, width = farthest.shape
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        row, column, along = pixel_of(x, y, z, camera, height, width)
        shown[k] = False
        if row < 0 or not along < farthest[row, column] + beyond:
            continue
        if before >= 0 and not along > nearest[row, column] - before:
            continue
        if square > 0 and not cosines[row, column] > square:
            continue
        if len(outwards) > 0:
            dx, dy, dz = camera[3] - x, camera[7] - y, camera[11] - z
            across = dx * outwards[k, 0] + dy * outwards[k, 1] + dz * outwards[k, 2]
            if not across > least * np.sqrt(dx * dx + dy * dy + dz * dz):
                continue
        shown[k] = True


@lean_kernel
def facing_cosines(points, normals, camera, cell, scratch, nearest, cosines):
    """How squarely a camera looks at a surface's points; -1 where the surface hides itself.

    The nearest point of each block of pixels hides what lies far behind it. A block is three cells
    wide, at the points' mean depth, or more if there are not as many.

    Parameters
    ----------
    points, normals : float64 [N, 3].
    camera : float64 [16].
    cell : Distance of points, world units.
    scratch : float64 [3, N].
    nearest : float64 [H, W], of as many blocks as there are at most.
    cosines : float64 [N], filled: between the normal and the way to the camera.
    """
    count, mean = len(points), 0.0
    across, down, along = scratch[0], scratch[1], scratch[2]
    for k in range(count):
        dx, dy, dz = (points[k, 0] - camera[3], points[k, 1] - camera[7], points[k, 2] - camera[11])
        depth = camera[2] * dx + camera[6] * dy + camera[10] * dz
        along[k] = depth
        mean += depth / count
        safe = max(depth, 1e-12)
        across[k] = (camera[0] * dx + camera[4] * dy + camera[8] * dz) / safe * camera[12]
        down[k] = (camera[1] * dx + camera[5] * dy + camera[9] * dz) / safe * camera[13]
        cosines[k] = -(dx * normals[k, 0] + dy * normals[k, 1] + dz * normals[k, 2]) / np.sqrt(
            dx * dx + dy * dy + dz * dz)
    # What lies next to the camera, or behind it, it does not look at.
    least = 0.05 * mean
    left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
    for k in range(count):
        if along[k] > least:
            left, right = min(left, across[k]), max(right, across[k])
            top, bottom = min(top, down[k]), max(bottom, down[k])
    if not right >= left:
        cosines[:] = -1.0
        return
    block = 3.0 * cell * max(camera[12], camera[13]) / mean
    block = max(block, (bottom - top) / (nearest.shape[0] - 1), (right - left) / (
        nearest.shape[1] - 1))
    nearest[:] = np.inf
    for k in range(count):
        if along[k] > least:
            row, column = int((down[k] - top) / block), int((across[k] - left) / block)
            nearest[row, column] = min(nearest[row, column], along[k])
    for k in range(count):
        hidden = not along[k] > least
        if not hidden:
            row, column = int((down[k] - top) / block), int((across[k] - left) / block)
            hidden = along[k] > nearest[row, column] + 5.0 * cell
        if hidden:
            cosines[k] = -1.0


@shared("origins")
@lean_kernel
def hull_along_rays(  # type: ignore[no-untyped-def]
        since, until, origins, rays, reach, shares, cameras, mattes, sizes, halvings, found):
    """Distances along rays up to which mattes do not rule a point out.

    A point is ruled out by more than 6 % of the views whose pictures it is in, if these are at
    least 40 % of all.

    Parameters
    ----------
    origins : float64 [V, 3], one a row.
    rays : float64 [V, U, 3].
    reach : float64 [V, U], of which ``shares`` [S] are looked at, rising; then halved.
    cameras : float64 [K, 16].
    mattes, sizes : float32 [K, H, W], in [0, 255], of sizes int64 [K, 2].
    halvings : Times that the way between the last two shares is halved.
    found : float64 [V, U], filled; NaN where nothing is ruled out.
    """
    for v in range(since, until):
        for u in range(rays.shape[1]):
            far = -1
            for s in range(len(shares)):
                if _ruled_out(origins[v], rays[v, u], shares[s] * reach[v, u], cameras, mattes,
                              sizes):
                    far = s
                    break
            if far < 0:
                found[v, u] = np.nan
                continue
            low, high = shares[max(far - 1, 0)], shares[far]
            for _ in range(halvings):
                middle = 0.5 * (low + high)
                if _ruled_out(origins[v], rays[v, u], middle * reach[v, u], cameras, mattes, sizes):
                    high = middle
                else:
                    low = middle
            found[v, u] = low * reach[v, u]


@lean
def _ruled_out(origin, ray, distance, cameras, mattes, sizes):
    x, y, z = (origin[0] + distance * ray[0], origin[1] + distance * ray[1],
               origin[2] + distance * ray[2])
    seen, against = 0, 0
    for k in range(len(cameras)):
        row, column, _ = pixel_of(x, y, z, cameras[k], sizes[k, 0], sizes[k, 1])
        if row >= 0:
            seen += 1
            if mattes[k, row, column] < 127.0:
                against += 1
    return against > 0.06 * seen and seen >= 0.4 * len(cameras)


_OUTSIDE = np.float32(-10.0)
"""In the place of a pixel that a picture does not show; pixels are in [0, 1]."""
_BESIDE = 3  # Pixels from the middle of a window to its sides.
_SHARE = np.float32(1.0 / (2 * _BESIDE + 1) ** 2)


@lean_kernel
def match_planes(  # type: ignore[no-untyped-def]
        reference, mean, variance, pictures, sizes, warps, scratch, top, winner, below, above):
    """Planes that other pictures agree on: normalized cross-correlation in windows of 7x7 pixels.

    The score of a plane is that of the picture that agrees most, or the mean of the two that do
    (others may look past an edge), averaged over 3x3 pixels. Beyond its border a picture is
    mirrored in its last pixel.

    Parameters
    ----------
    reference, mean, variance : float32 [h, w]: levels in [0, 1]; their mean and variance in each
        window.
    pictures, sizes : float32 [N, H, W] and int64 [N, 2]: the others, and how many rows and
        columns each has.
    warps : float64 [P, N, 3, 3], from the reference's pixels to those of the others, by planes.
    scratch : float32 [h, w], [h, w], [R, h, w], [3, w + 8], [3, w], [2, w] and [w], overwritten.
        R pictures, one or two, count.
    top, winner : float32 [h, w] and int32 [h, w], filled: the largest score and the first plane
        that has it.
    below, above : float32 [h, w], filled: the scores of the planes before and after it; anything
        where there are none.
    """
    height, width = reference.shape
    planes, others = warps.shape[:2]
    moved, recent, best, sums, totals, places, scores = scratch
    for plane in range(planes):
        for other in range(others):
            for y in range(height):
                _warped_places(warps[plane, other], y, places)
                _look_up(pictures[other], sizes[other, 0], sizes[other, 1], places, moved[y])
            for y in range(height):
                _clear(sums)
                for line in range(y - _BESIDE, y + _BESIDE + 1):
                    at = _mirrored(line, height)
                    _add_line(moved[at], reference[at], sums)
                for k in range(3):
                    _mirror_ends(sums[k], width, _BESIDE)
                    _seven_across(sums[k], totals[k])
                _correlate(totals, mean[y], variance[y], moved[y], scores)
                _keep_best(scores, best[0, y], best[len(best) - 1, y], other == 0)
        for y in range(height):
            _clear(sums)
            for line in range(y - 1, y + 2):
                at = _mirrored(line, height)
                _add_both(best[0, at], best[len(best) - 1, at], sums[0])
            _mirror_ends(sums[0], width, 1)
            _three_across(sums[0], scores)
            _note_peak(scores, plane, recent[y], top[y], winner[y], below[y], above[y])


@lean_kernel
def surface_agreement(  # type: ignore[no-untyped-def]
        points, cameras, pictures, sizes, weights, beside, scratch, values, score, total, own):
    """How well pictures agree, in windows of the cells of a surface, with their mean.

    Normalized cross-correlation of what each picture shows of the cells, less its mean in the
    window. Beyond its border the surface is mirrored in its last cell.

    Parameters
    ----------
    points : float64 [V, U, 3], the cells in the world.
    cameras, pictures, sizes : float64 [K, 16]; float32 [K, H, W], levels in [0, 1]; int64 [K,
        2], rows and columns.
    weights : float32 [K, V, U], how far a picture counts in each cell.
    beside : Cells from the middle of a window to its sides, at most 4.
    scratch : float32 [V, U], [2, U + 8], [2, U], overwritten.
    values : float32 [2, K, V, U], filled: levels less their mean; weights, 0 where a picture
        does not show a cell.
    score, total, own : float32 [V, U] each, filled: weighted sum of the correlations, sum of the
        weights, variance of the weighted mean.
    """
    mean, sums, totals = scratch
    levels, shares = values[0], values[1]
    count, height, width = levels.shape
    share = np.float32(1.0 / (2 * beside + 1) ** 2)
    for k in range(count):
        for y in range(height):
            _look_at(points[y], cameras[k], pictures[k], sizes[k, 0], sizes[k, 1], weights[k, y],
                     levels[k, y], shares[k, y])
        for y in range(height):
            _clear(sums)
            for line in range(y - beside, y + beside + 1):
                _add(levels[k, _mirrored(line, height)], sums[0, 4:])
            _sum_across(sums[0], beside, mean[y])
        for y in range(height):
            _add_scaled(mean[y], -share, levels[k, y])
    for y in range(height):
        score[y], total[y], mean[y] = np.float32(0), np.float32(0), np.float32(0)
        for k in range(count):
            _add(shares[k, y], total[y])
            _add_products(shares[k, y], levels[k, y], mean[y])
        for x in range(width):
            mean[y, x] /= max(total[y, x], np.float32(1e-6))
    for y in range(height):
        _clear(sums)
        for line in range(y - beside, y + beside + 1):
            at = _mirrored(line, height)
            _add_products(mean[at], mean[at], sums[0, 4:])
        _sum_across(sums[0], beside, own[y])
        for x in range(width):
            own[y, x] *= share
    for k in range(count):
        for y in range(height):
            _clear(sums)
            for line in range(y - beside, y + beside + 1):
                at = _mirrored(line, height)
                _add_products(levels[k, at], mean[at], sums[0, 4:])
                _add_products(levels[k, at], levels[k, at], sums[1, 4:])
            _sum_across(sums[0], beside, totals[0])
            _sum_across(sums[1], beside, totals[1])
            _add_correlations(totals, own[y], share, shares[k, y], score[y])


# Each of these loops is a function of its own, of few arrays: only then are they distinguished at
# run time and done eight pixels at a time. Lines of sums begin at place 4.

@lean
def _warped_places(warp, y, places):
    """Where the pixels of row ``y`` are in the other picture: its columns, its rows."""
    a, d, g = np.float32(warp[0, 0]), np.float32(warp[1, 0]), np.float32(warp[2, 0])
    b = np.float32(warp[0, 1] * y + warp[0, 2])
    e = np.float32(warp[1, 1] * y + warp[1, 2])
    h = np.float32(warp[2, 1] * y + warp[2, 2])
    for x in range(places.shape[1]):
        along = np.float32(x)
        over = np.float32(1) / (g * along + h)
        places[0, x] = (a * along + b) * over
        places[1, x] = (d * along + e) * over


@lean
def _look_up(picture, high, wide, places, moved):
    """A picture at places, bilinear."""
    right, low, stride = np.float32(wide - 1), np.float32(high - 1), picture.shape[1]
    pixels = picture.reshape(-1)
    for x in range(len(moved)):
        u, v = places[0, x], places[1, x]
        if u >= 0 and v >= 0 and u < right and v < low:
            i, j = np.int32(u), np.int32(v)
            fu, fv = u - np.float32(i), v - np.float32(j)
            at = np.uint32(j * stride + i)
            upper = pixels[at] + fu * (pixels[at + 1] - pixels[at])
            lower = pixels[at + stride] + fu * (pixels[at + stride + 1] - pixels[at + stride])
            moved[x] = upper + fv * (lower - upper)
        else:
            moved[x] = _OUTSIDE


@lean
def _mirrored(place, length):
    """A place as far inside of the border as ``place`` is outside."""
    while place < 0 or place >= length:
        place = abs(place) if place < length else 2 * length - 2 - place
        if length == 1:
            return 0
    return place


@lean
def _mirror_ends(line, width, beside):
    """Fill the places before and after a line of sums."""
    for x in range(1, beside + 1):
        line[4 - x] = line[4 + _mirrored(x, width)]
        line[3 + width + x] = line[4 + _mirrored(width - 1 + x, width)]


@lean
def _clear(sums):
    for k in range(len(sums)):
        for x in range(sums.shape[1]):
            sums[k, x] = np.float32(0)


@lean
def _add_line(moved, reference, sums):
    """Add a row: its levels, their squares, and their products with the reference's."""
    for x in range(len(moved)):
        level = moved[x]
        sums[0, 4 + x] += level
        sums[1, 4 + x] += level * level
        sums[2, 4 + x] += level * reference[x]


@lean
def _seven_across(line, total):
    for x in range(len(total)):
        total[x] = (((line[x + 1] + line[x + 2]) + (line[x + 3] + line[x + 4]))
                    + ((line[x + 5] + line[x + 6]) + line[x + 7]))


@lean
def _correlate(totals, mean, variance, moved, scores):
    """Normalized cross-correlation of a row, -1 where the other picture shows nothing."""
    for x in range(len(scores)):
        level = totals[0, x] * _SHARE
        spread = variance[x] * (totals[1, x] * _SHARE - level * level)
        score = (totals[2, x] * _SHARE - mean[x] * level) / np.sqrt(max(spread, np.float32(1e-8)))
        scores[x] = np.float32(-1) if moved[x] <= np.float32(-0.5) else score


@lean
def _keep_best(scores, one, two, first):
    """Keep the two best scores of a row; the best one where both are one array."""
    if first:
        for x in range(len(scores)):
            two[x] = np.float32(-np.inf)
        for x in range(len(scores)):
            one[x] = scores[x]
        return
    for x in range(len(scores)):
        best, second, score = one[x], two[x], scores[x]
        low = score if score < best else best
        two[x] = low if low > second else second
        one[x] = score if score > best else best


@lean
def _add_both(one, two, line):
    for x in range(len(one)):
        line[4 + x] += one[x] + two[x]


@lean
def _three_across(line, total):
    for x in range(len(total)):
        total[x] = ((line[x + 3] + line[x + 4]) + line[x + 5]) * np.float32(1.0 / 18.0)


@lean
def _note_peak(scores, plane, recent, top, winner, below, above):
    """Take note of where a row's scores are the largest so far; ``recent`` are the last plane's."""
    if plane == 0:
        for x in range(len(scores)):
            top[x] = recent[x] = below[x] = above[x] = scores[x]
            winner[x] = 0
        return
    for x in range(len(scores)):
        score = scores[x]
        if winner[x] == plane - 1:
            above[x] = score
        if score > top[x]:
            top[x], winner[x], below[x] = score, plane, recent[x]
        recent[x] = score


@lean
def _look_at(points, camera, picture, high, wide, weight, levels, shares):
    """What a picture shows of a line of points, bilinear, and its weights: 0 outside of it."""
    right, low = wide - 1.0, high - 1.0
    for x in range(len(levels)):
        dx, dy, dz = points[x, 0] - camera[3], points[x, 1] - camera[7], points[x, 2] - camera[11]
        along = camera[2] * dx + camera[6] * dy + camera[10] * dz
        over = 1.0 / max(along, 1e-6)
        u = (camera[0] * dx + camera[4] * dy + camera[8] * dz) * over * camera[12]
        v = (camera[1] * dx + camera[5] * dy + camera[9] * dz) * over * camera[13]
        u, v = u + camera[14] - 0.5, v + camera[15] - 0.5
        if along > 1e-6 and u >= 0 and v >= 0 and u < right and v < low:
            i, j = int(u), int(v)
            fu, fv = np.float32(u - i), np.float32(v - j)
            upper = picture[j, i] + fu * (picture[j, i + 1] - picture[j, i])
            lower = picture[j + 1, i] + fu * (picture[j + 1, i + 1] - picture[j + 1, i])
            levels[x], shares[x] = upper + fv * (lower - upper), weight[x]
        else:
            levels[x] = shares[x] = np.float32(0)


@lean
def _add(values, line):
    for x in range(len(values)):
        line[x] += values[x]


@lean
def _add_scaled(values, factor, line):
    for x in range(len(values)):
        line[x] += factor * values[x]


@lean
def _add_products(one, two, line):
    for x in range(len(one)):
        line[x] += one[x] * two[x]


@lean
def _sum_across(line, beside, total):
    """Sums over windows of a line of sums."""
    _mirror_ends(line, len(total), beside)
    total[:] = np.float32(0)
    for k in range(4 - beside, 5 + beside):
        _add(line[k:k + len(total)], total)


@lean
def _add_correlations(totals, own, share, weights, score):
    for x in range(len(score)):
        spread = totals[1, x] * share * own[x]
        score[x] += weights[x] * (totals[0, x] * share) / np.sqrt(max(spread, np.float32(1e-12)))
