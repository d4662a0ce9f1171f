"""Hot loops of mattes: votes of the views on a lattice, and local statistics of a picture's colors.

Views vote on which points of a lattice belong to the person.

The statistics are what mattes are sharpened by: the Gaussian of the colors in each block of a
picture and how likely a pixel is under it; and a matte as a linear function of the colors in each
window (He et al. 2013, "Guided Image Filtering"). Only pixels near an outline are asked, so all of
it is done in one go a line, without the dozens of pictures in between that NumPy needs.
"""

import numpy as np
from numba import njit

from ..simd.decorators import lean, lean_kernel
from ..simd.threads import shared
from ..simd.vectors import LANES


@lean
def _along_row(camera, first, spacing, j, k, line):
    """A row of the lattice in a picture: column and row times depth, and depth, at its first point.

    ``line`` float32 [6] is filled: these three, and what each point adds to them.
    """
    dx, dy, dz = first[0] - camera[3], first[1] + spacing[1] * j - camera[7], (
        first[2] + spacing[2] * k - camera[11])
    for axis in range(3):
        at = camera[axis] * dx + camera[4 + axis] * dy + camera[8 + axis] * dz
        step = spacing[0] * camera[axis]
        if axis == 2:
            line[2], line[5] = at, step
            line[0] += camera[14] * at
            line[1] += camera[15] * at
            line[3] += camera[14] * step
            line[4] += camera[15] * step
        else:
            line[axis], line[3 + axis] = camera[12 + axis] * at, camera[12 + axis] * step


def vote_lattice(  # type: ignore[no-untyped-def]
        cameras, mattes, shapes, first, spacing, size, tolerance):
    """The share of the person in the votes on each lattice point ``first + spacing (x, y, z)``.

    Parameters
    ----------
    cameras : float64 [V, 16], a row a view: pose (camera-to-world, three rows), focal, center.
    mattes : float32, the V mattes in [0, 1] one after the other, each in scan order.
    shapes : int64 [V, 2], height and width of each matte.
    first, spacing, size : The lattice: float64 [3], a step, and points along an edge.
    tolerance : A point is given up once the background has more than this share of all V votes.

    Returns
    -------
    share : float32 [size, size, size] (z, y, x), the mean matte over the views that have the
        point in the picture; 0 where it was given up, 1 where no picture shows it.
    """
    wide = (size + 15) // 16 * 16
    share = np.empty((size, size, wide), np.float32)
    starts = np.concatenate([[0], np.cumsum(shapes[:, 0] * shapes[:, 1])])
    lines = np.empty((size, len(cameras), 6), np.float32)
    steps = np.full(3, spacing)
    _vote(cameras, mattes, shapes, starts, first, steps, np.float32(tolerance * len(cameras)),
          lines, share)
    return np.ascontiguousarray(share[..., :size])


_store, _floats, _ints, _iota = LANES.store, LANES.floats, LANES.ints, LANES.iota
_where, _bits, _gather = LANES.where, LANES.bits, LANES.gather
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


@lean
def _seen_at(line, place, shape):
    """Rows and columns of sixteen points of a lattice's row (`_along_row`), and which are shown."""
    depth = line[2] + line[5] * place
    inverse = _ONE / depth
    column = (line[0] + line[3] * place) * inverse
    row = (line[1] + line[4] * place) * inverse
    inside = ((depth > np.float32(1e-9)) & (column >= _ZERO) & (row >= _ZERO)
              & (column < np.float32(shape[1])) & (row < np.float32(shape[0])))
    return row, column, inside


@shared("share")
@lean_kernel
def _vote(since, until, cameras, mattes, shapes, starts, first, spacing, limit, lines, share):
    """Fill what `vote_lattice` gives, sixteen points of a row at a time.

    Each view's matte begins at ``starts``; ``lines`` [size, V, 6] is scratch.
    """
    count, size, wide = len(cameras), share.shape[1], share.shape[2]
    for k in range(since, until):
        for j in range(size):
            for view in range(count):
                _along_row(cameras[view], first, spacing, j, k, lines[k, view])
            for i in range(0, wide, 16):
                place = _floats(_iota() + np.int32(i))
                seen, against = _floats(_ZERO), _floats(_ZERO)
                for view in range(count):
                    row, column, inside = _seen_at(lines[k, view], place, shapes[view])
                    if _bits(inside) == 0:
                        continue
                    pixel = (_ints(_where(inside, row, _ZERO)) * np.int32(shapes[view, 1])
                             + _ints(_where(inside, column, _ZERO)))
                    matte = mattes[starts[view]:starts[view + 1]]  # lanes count up to 2^31
                    seen = seen + _where(inside, _floats(_ONE), _ZERO)
                    against = against + _where(inside, _ONE - _gather(matte, pixel), _ZERO)
                    if _bits(against <= limit) == 0:
                        break
                mean = _where(seen > _ZERO, _ONE - against / seen, _ONE)
                _store(share[k, j], np.uintp(i), _where(against <= limit, mean, _ZERO))


def count_votes(  # type: ignore[no-untyped-def]
        cameras, packed, shapes, first, spacing, size, limit, asked):
    """How many views have each point of a lattice in the picture, and how many show it empty.

    Parameters
    ----------
    cameras : float64 [V, 16], a row a view: pose (camera-to-world, three rows), focal, center.
    packed : V pictures, uint8 each, the bits of bool [H, W] in scan order, lowest first; false is
        nothing. Or none at all: then all are empty.
    shapes : int64 [V, 2], height and width of each picture.
    first, spacing : float64 [3] each (x, y, z), the first point and the steps.
    size : Points along z, y and x.
    limit : Views after which that show a point empty no more are asked.
    asked : bool [Z, Y, X], or None: all are.

    Returns
    -------
    seen, against : float32 [Z, Y, X]; zero where nothing was asked.
    """
    deep, high, across = size
    wide = (across + 15) // 16 * 16
    # Each picture begins with a word of 32 pixels.
    starts = np.cumsum([0] + [-(-len(bits) // 4) for bits in packed])
    words = np.zeros(max(1, int(starts[-1])), np.int32)
    for bits, start in zip(packed, starts):
        words[start:].view(np.uint8)[:len(bits)] = bits
    some = np.full((1, 1, 1), True)
    if asked is not None:
        some = np.zeros((deep, high, wide), np.bool_)
        some[..., :across] = asked
    seen, against = (np.zeros((deep, high, wide), np.float32) for _ in range(2))
    lines = np.empty((deep, len(cameras), 6), np.float32)
    _count(cameras, words, starts, shapes, first, spacing, np.float32(limit), some, lines, seen,
           against)
    return seen[..., :across], against[..., :across]


@shared("seen")
@lean_kernel
def _count(since, until, cameras, words, starts, shapes, first, spacing, limit, some, lines, seen,
           against):
    """Fill what `count_votes` gives, sixteen points of a row at a time.

    ``words`` int32 hold the pixels' bits, each view's from ``starts`` on; ``some`` bool [Z, Y, X],
    or [1, 1, 1] if all are asked; ``lines`` [Z, V, 6] is scratch.
    """
    count, high, wide = len(cameras), seen.shape[1], seen.shape[2]
    empty, all_asked = len(starts) == 1, some.size == 1
    for k in range(since, until):
        for j in range(high):
            ready = False
            for i in range(0, wide, 16):
                wanted = all_asked
                if not all_asked:
                    for place in range(i, i + 16):
                        wanted |= some[k, j, place]
                if not wanted:
                    continue
                if not ready:
                    for view in range(count):
                        _along_row(cameras[view], first, spacing, j, k, lines[k, view])
                    ready = True
                place = _floats(_iota() + np.int32(i))
                views, nothing = _floats(_ZERO), _floats(_ZERO)
                for view in range(count):
                    row, column, inside = _seen_at(lines[k, view], place, shapes[view])
                    if _bits(inside) == 0:
                        continue
                    views = views + _where(inside, _floats(_ONE), _ZERO)
                    if empty:
                        continue
                    pixel = (_ints(_where(inside, row, _ZERO)) * np.int32(shapes[view, 1])
                             + _ints(_where(inside, column, _ZERO)))
                    word = _gather(words[starts[view]:starts[view + 1]], pixel >> np.int32(5))
                    bit = (word >> (pixel & np.int32(31))) & np.int32(1)
                    nothing = nothing + _where(inside, _ONE - _floats(bit), _ZERO)
                    if _bits(nothing <= limit) == 0:
                        break
                _store(seen[k, j], np.uintp(i), views)
                _store(against[k, j], np.uintp(i), nothing)


def cover_views(camera, points, first, spacing, height, width):  # type: ignore[no-untyped-def]
    """Pixels, bool [height, width], in which one of the lattice's ``points`` lies.

    ``points`` is bool [Z, Y, X].
    """
    covered = np.zeros((height, width), np.bool_)
    _cover(camera, points, first, np.full(3, spacing), np.empty(6, np.float32), covered)
    return covered


@lean_kernel
def _cover(camera, points, first, spacing, line, covered):
    """`cover_views`; ``line`` is scratch."""
    height, width = covered.shape
    for k in range(points.shape[0]):
        for j in range(points.shape[1]):
            ready = False
            for i in range(points.shape[2]):
                if not points[k, j, i]:
                    continue
                if not ready:
                    _along_row(camera, first, spacing, j, k, line)
                    ready = True
                place = np.float32(i)
                depth = line[2] + line[5] * place
                if depth <= np.float32(1e-9):
                    continue
                inverse = _ONE / depth
                column = (line[0] + line[3] * place) * inverse
                row = (line[1] + line[4] * place) * inverse
                if _ZERO <= column < np.float32(width) and _ZERO <= row < np.float32(height):
                    covered[int(row), int(column)] = True


MOMENTS = 10
"""Numbers of a block: weight; weighted colors; their products with the colors, upper triangle."""
TERMS = 12
"""Numbers of a Gaussian: mean; inverse covariance, upper triangle, off the diagonal twice;
logarithm of the determinant; weight; the last one is unused."""
_FLOOR = np.float32(4e-4)
"""Variance of a color: sensor noise, and so that a flat patch does not exclude its own shading."""


@njit(cache=True, inline="always")
def _adjugate(xx, xy, xz, yy, yz, zz):  # type: ignore[no-untyped-def]
    """The adjugate's upper half, row by row, and the determinant, at least tiny."""
    i00, i01, i02 = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    i11, i12, i22 = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    return i00, i01, i02, i11, i12, i22, max(xx * i00 + xy * i01 + xz * i02, np.float32(1e-12))


@shared("moments")
@lean_kernel
def block_moments(since, until, image, weight, cell, moments):  # type: ignore[no-untyped-def]
    """Means of weights, colors and products of colors over blocks of ``cell`` x ``cell`` pixels.

    Parameters
    ----------
    image, weight : float32 [H, W, 3] and [H, W].
    cell : Pixels along a side; blocks at the right and lower border are smaller.
    moments : float32 [h, w, `MOMENTS`], filled.
    """
    height, width = weight.shape
    for row in range(since, until):
        top, bottom = row * cell, min((row + 1) * cell, height)
        for column in range(moments.shape[1]):
            left, right = column * cell, min((column + 1) * cell, width)
            block = moments[row, column]
            for k in range(10):
                block[k] = np.float32(0)
            for y in range(top, bottom):
                for x in range(left, right):
                    some = weight[y, x]
                    if some == 0:
                        continue
                    r, g, b = image[y, x, 0], image[y, x, 1], image[y, x, 2]
                    wr, wg, wb = some * r, some * g, some * b
                    block[0] += some
                    block[1] += wr
                    block[2] += wg
                    block[3] += wb
                    block[4] += wr * r
                    block[5] += wr * g
                    block[6] += wr * b
                    block[7] += wg * g
                    block[8] += wg * b
                    block[9] += wb * b
            share = np.float32(1.0 / ((bottom - top) * (right - left)))
            for k in range(10):
                block[k] *= share


@shared("moments")
@lean_kernel
def gaussians(since, until, moments, terms):  # type: ignore[no-untyped-def]
    """The Gaussian of each block's colors: terms [h, w, `TERMS`] of moments [h, w, `MOMENTS`]."""
    for row in range(since, until):
        for column in range(moments.shape[1]):
            block, own = moments[row, column], terms[row, column]
            one = np.float32(1) / max(block[0], np.float32(1e-4))
            r, g, b = block[1] * one, block[2] * one, block[3] * one
            xx = block[4] * one - r * r + _FLOOR
            xy, xz = block[5] * one - r * g, block[6] * one - r * b
            yy = block[7] * one - g * g + _FLOOR
            yz = block[8] * one - g * b
            zz = block[9] * one - b * b + _FLOOR
            i00, i01, i02, i11, i12, i22, determinant = _adjugate(xx, xy, xz, yy, yz, zz)
            over = np.float32(1) / determinant
            own[0], own[1], own[2] = r, g, b
            own[3], own[4], own[5] = i00 * over, 2 * i01 * over, 2 * i02 * over
            own[6], own[7], own[8] = i11 * over, 2 * i12 * over, i22 * over
            own[9], own[10], own[11] = np.log(determinant), block[0], np.float32(0)


@shared("image")
@lean_kernel
def pixel_likelihood(  # type: ignore[no-untyped-def]
        since, until, image, terms, cell, wanted, scratch, likelihood, near):
    """Log-likelihood of pixels under Gaussians that are interpolated between blocks.

    Parameters
    ----------
    image : float32 [H, W, 3].
    terms : float32 [h, w, `TERMS`] of the blocks (`gaussians`).
    cell : Pixels along a block.
    wanted : uint8 [H, W], zero where nothing is asked and nothing is written.
    scratch : float32 [H, w, `TERMS`], overwritten.
    likelihood, near : float32 [H, W] each: without the constant, and the weight near a pixel.
    """
    high, wide = terms.shape[0], terms.shape[1]
    width = image.shape[1]
    step = np.float32(1.0 / cell)
    half = np.float32(0.5)
    for y in range(since, until):
        some = False
        for x in range(width):
            some |= wanted[y, x] != 0
        if not some:
            continue
        place = min(max((y + half) * step - half, np.float32(0)), np.float32(high - 1))
        top = min(int(place), max(high - 2, 0))
        below = min(top + 1, high - 1)
        part = np.float32(place - top)
        upper, lower, line = terms[top], terms[below], scratch[y]
        for column in range(wide):
            for k in range(12):
                line[column, k] = upper[column, k] + part * (lower[column, k] - upper[column, k])
        for x in range(width):
            if wanted[y, x] == 0:
                continue
            place = min(max((x + half) * step - half, np.float32(0)), np.float32(wide - 1))
            left = min(int(place), max(wide - 2, 0))
            part = np.float32(place - left)
            a, c = line[left], line[min(left + 1, wide - 1)]
            r = image[y, x, 0] - (a[0] + part * (c[0] - a[0]))
            g = image[y, x, 1] - (a[1] + part * (c[1] - a[1]))
            b = image[y, x, 2] - (a[2] + part * (c[2] - a[2]))
            distance = a[9] + part * (c[9] - a[9])
            distance += (a[3] + part * (c[3] - a[3])) * r * r
            distance += (a[4] + part * (c[4] - a[4])) * r * g
            distance += (a[5] + part * (c[5] - a[5])) * r * b
            distance += (a[6] + part * (c[6] - a[6])) * g * g
            distance += (a[7] + part * (c[7] - a[7])) * g * b
            distance += (a[8] + part * (c[8] - a[8])) * b * b
            likelihood[y, x] = -half * distance
            near[y, x] = a[10] + part * (c[10] - a[10])


@shared("plane")
@lean_kernel
def window_functions(  # type: ignore[no-untyped-def]
        since, until, image, plane, wanted, radius, epsilon, scratch, functions):
    """The linear function of the colors that is nearest to a plane, in the window of each pixel.

    He et al. 2013, Eq. 19 and 20. Beyond its border a picture goes on with its last pixel.

    Parameters
    ----------
    image, plane : float32 [H, W, 3] and [H, W].
    wanted : uint8 [H, W], zero where no function is asked and nothing is written.
    radius, epsilon : Half the window's side in pixels, and the variance of a color that counts
        as an edge.
    scratch : float32 [H, W, 16], overwritten.
    functions : float32 [H, W, 4], filled: slopes by the colors, offset.
    """
    height, width = plane.shape
    share = np.float32(1.0 / (2 * radius + 1) ** 2)
    for y in range(since, until):
        sums, row = scratch[y], wanted[y]
        first, last = width, -1
        for x in range(width):
            if row[x] != 0:
                first, last = min(first, x), x
        # Sums over the window's rows, for each column that a window of the row has.
        for x in range(max(first - radius, 0), min(last + radius, width - 1) + 1):
            some = False
            for beside in range(max(x - radius, 0), min(x + radius, width - 1) + 1):
                some |= row[beside] != 0
            if not some:
                continue
            column = sums[x]
            for k in range(13):
                column[k] = np.float32(0)
            for line in range(y - radius, y + radius + 1):
                at = min(max(line, 0), height - 1)
                r, g, b, level = image[at, x, 0], image[at, x, 1], image[at, x, 2], plane[at, x]
                column[0] += r
                column[1] += g
                column[2] += b
                column[3] += r * r
                column[4] += r * g
                column[5] += r * b
                column[6] += g * g
                column[7] += g * b
                column[8] += b * b
                column[9] += level
                column[10] += r * level
                column[11] += g * level
                column[12] += b * level
        for x in range(first, last + 1):
            if row[x] == 0:
                continue
            r = g = b = rr = rg = rb = gg = gb = bb = np.float32(0)
            level = red = green = blue = np.float32(0)
            for place in range(x - radius, x + radius + 1):
                column = sums[min(max(place, 0), width - 1)]
                r += column[0]
                g += column[1]
                b += column[2]
                rr += column[3]
                rg += column[4]
                rb += column[5]
                gg += column[6]
                gb += column[7]
                bb += column[8]
                level += column[9]
                red += column[10]
                green += column[11]
                blue += column[12]
            r, g, b, level = r * share, g * share, b * share, level * share
            xx, yy, zz = rr * share - r * r + epsilon, gg * share - g * g + epsilon, (
                bb * share - b * b + epsilon)
            xy, xz, yz = rg * share - r * g, rb * share - r * b, gb * share - g * b
            red, green, blue = red * share - r * level, green * share - g * level, (
                blue * share - b * level)
            i00, i01, i02, i11, i12, i22, determinant = _adjugate(xx, xy, xz, yy, yz, zz)
            over = np.float32(1) / determinant
            own = functions[y, x]
            own[0] = (i00 * red + i01 * green + i02 * blue) * over
            own[1] = (i01 * red + i11 * green + i12 * blue) * over
            own[2] = (i02 * red + i12 * green + i22 * blue) * over
            own[3] = level - own[0] * r - own[1] * g - own[2] * b


@shared("image")
@lean_kernel
def apply_functions(since, until, image, functions, wanted, result):  # type: ignore[no-untyped-def]
    """Linear functions of the colors, interpolated between blocks of pixels, at each pixel.

    Parameters
    ----------
    image : float32 [H, W, 3].
    functions : float32 [h, w, 4], slopes and offset of each of h x w blocks of the picture.
    wanted : uint8 [H, W], zero where nothing is asked and nothing is written.
    result : float32 [H, W], filled.
    """
    height, width = wanted.shape
    high, wide = functions.shape[0], functions.shape[1]
    half = np.float32(0.5)
    down, along = np.float32(high / height), np.float32(wide / width)
    for y in range(since, until):
        place = min(max((y + half) * down - half, np.float32(0)), np.float32(high - 1))
        top = int(place)
        upper, lower = functions[top], functions[min(top + 1, high - 1)]
        below = np.float32(place - top)
        above = np.float32(1) - below
        for x in range(width):
            if wanted[y, x] == 0:
                continue
            place = min(max((x + half) * along - half, np.float32(0)), np.float32(wide - 1))
            left = int(place)
            right = min(left + 1, wide - 1)
            after = np.float32(place - left)
            before = np.float32(1) - after
            a, b, c, d = upper[left], upper[right], lower[left], lower[right]
            total = above * (before * a[3] + after * b[3]) + below * (before * c[3] + after * d[3])
            for k in range(3):
                total += image[y, x, k] * (above * (before * a[k] + after * b[k])
                                           + below * (before * c[k] + after * d[k]))
            result[y, x] = total
