"""Hot loops of the guides: moving least squares, folding, blurs, histograms, signed distances.

Moving least squares with similarities (Schaefer et al. 2006) in complex numbers: for a point v, the
map f(z) = a (z - p*) + q* that minimises sum_i |f(p_i) - q_i|^2 / |p_i - v|^2 has
a = sum w conj(p_i - p*) (q_i - q*) / sum w |p_i - p*|^2, with p*, q* the weighted means. It is read
off five weighted sums, so a point costs one pass over the control points.

Outlines are matched by signed distances, which come from sweeps, and by shifts along them.

All loops over a row of pixels are free of branches, so that they vectorise.
"""

import numba
import numpy as np

from ...simd.decorators import kernel, lean_kernel, woven
from ...simd.threads import shared

_ORDER_FREE = {"reassoc", "contract", "arcp", "nsz"}
"""Sums may be taken in any order; NaN and infinity keep their meaning."""


@shared("points")
@kernel(fastmath=_ORDER_FREE)
def mls_points(since, until, points, sources, targets, weights, softness, out):
    """Map ``points`` [N, 2] by moving least squares (similarity) into ``out`` [N, 2], float64.

    ``sources`` and ``targets`` [M, 2] are the control points, ``weights`` [M] their importance;
    ``softness`` [M] is added to their squared distance: above 0 they attract but do not pin.
    """
    source_x, source_y = sources[:, 0].copy(), sources[:, 1].copy()
    target_x, target_y = targets[:, 0].copy(), targets[:, 1].copy()
    for n in range(since, until):
        vx, vy = points[n, 0], points[n, 1]
        total = px = py = qx = qy = square = real = imaginary = 0.0
        for m in range(source_x.shape[0]):
            # Coordinates relative to v keep the moments small, hence accurate.
            ax, ay = source_x[m] - vx, source_y[m] - vy
            bx, by = target_x[m] - vx, target_y[m] - vy
            distance = ax * ax + ay * ay
            # A point on a control point gets a weight beside which all others vanish.
            w = weights[m] / max(distance + softness[m], 1e-12)
            total += w
            px += w * ax
            py += w * ay
            qx += w * bx
            qy += w * by
            square += w * distance
            real += w * (ax * bx + ay * by)
            imaginary += w * (ax * by - ay * bx)
        px, py, qx, qy = px / total, py / total, qx / total, qy / total
        spread = square / total - (px * px + py * py)
        if spread > 1e-12:
            real = (real / total - (px * qx + py * qy)) / spread
            imaginary = (imaginary / total - (px * qy - py * qx)) / spread
        else:
            real, imaginary = 1.0, 0.0
        out[n, 0] = vx + qx - (real * px - imaginary * py)
        out[n, 1] = vy + qy - (real * py + imaginary * px)


@numba.njit(cache=True, inline="always")
def _fold(value, length, before, after):
    """Reflect a coordinate to and fro in the strips ``before`` and ``after`` of [0, length)."""
    if value < 0:
        beyond = (-value) % (2 * before)
        return min(beyond, 2 * before - beyond)
    last = length - np.float32(0.01)
    if value > last:
        beyond = (value - last) % (2 * after)
        return last - min(beyond, 2 * after - beyond)
    return value


@shared("points")
@lean_kernel
def fold_points(since, until, points, size, before, after):
    """Fold ``points`` [N, 2] float32 into a picture in place; see `guides.fold_inside`.

    ``size``, ``before`` and ``after`` are float32 [2] (x, y).
    """
    for n in range(since, until):
        for c in range(2):
            points[n, c] = _fold(points[n, c], size[c], before[c], after[c])


@shared("out")
@lean_kernel
def resample_grid(since, until, nodes, spacing, out):
    """Bilinear interpolation of grid values to pixels.

    ``nodes`` [h, w, C] lie at pixel (i * spacing); ``out`` [H, W, C] float32 is filled.
    """
    width, channels = out.shape[1:]
    for y in range(since, until):
        j = min(y // spacing, nodes.shape[0] - 2)
        fy = np.float32((y - j * spacing) / spacing)
        for x in range(width):
            i = min(x // spacing, nodes.shape[1] - 2)
            fx = np.float32((x - i * spacing) / spacing)
            for c in range(channels):
                top = nodes[j, i, c] + fx * (nodes[j, i + 1, c] - nodes[j, i, c])
                low = nodes[j + 1, i, c] + fx * (nodes[j + 1, i + 1, c] - nodes[j + 1, i, c])
                out[y, x, c] = top + fy * (low - top)


@shared("cover")
@lean_kernel
def resample_fold(since, until, nodes, spacing, cover, size, before, after, out):
    """Bilinear interpolation of a grid of places, folded into the exemplar; NaN where not covered.

    ``nodes`` float32 [h, w, 2] lie at pixel (i * spacing); ``cover`` float32 [H, W];
    ``out`` [H, W, 2] float32 is filled; the rest as `fold_points`.
    """
    width = cover.shape[1]
    one = np.float32(1)
    for y in range(since, until):
        j = min(y // spacing, nodes.shape[0] - 2)
        fy = np.float32((y - j * spacing) / spacing)
        for i in range(nodes.shape[1] - 1):
            ax = nodes[j, i, 0] + fy * (nodes[j + 1, i, 0] - nodes[j, i, 0])
            ay = nodes[j, i, 1] + fy * (nodes[j + 1, i, 1] - nodes[j, i, 1])
            bx = nodes[j, i + 1, 0] + fy * (nodes[j + 1, i + 1, 0] - nodes[j, i + 1, 0])
            by = nodes[j, i + 1, 1] + fy * (nodes[j + 1, i + 1, 1] - nodes[j, i + 1, 1])
            end = width if i == nodes.shape[1] - 2 else min((i + 1) * spacing, width)
            for x in range(i * spacing, end):
                if cover[y, x] > 0:
                    fx = np.float32(x - i * spacing) * (one / np.float32(spacing))
                    out[y, x, 0] = _fold(ax + fx * (bx - ax), size[0], before[0], after[0])
                    out[y, x, 1] = _fold(ay + fx * (by - ay), size[1], before[1], after[1])
                else:
                    out[y, x, 0] = out[y, x, 1] = np.float32(np.nan)


@numba.njit(cache=True, inline="always")
def _mirrored(index, length):
    """An index beyond the ends of ``range(length)``, reflected into it."""
    while index < 0 or index >= length:
        index = -index - 1 if index < 0 else 2 * length - 1 - index
    return index


@woven(fastmath=True)
def _accumulate_rows(image, y, taps, row):
    """Sum the rows about ``y``, weighted by ``taps``, mirrored margin, into ``row`` [W + 2 r]."""
    height, width = image.shape
    radius = taps.shape[0] // 2
    centre, weight = image[y], taps[radius]
    inner = row[radius:radius + width]
    for x in range(width):
        inner[x] = weight * centre[x]
    # Two rows above and two below at a time: the sum is read and written half as often.
    for k in range(1, radius, 2):
        above, below = image[_mirrored(y - k, height)], image[_mirrored(y + k, height)]
        over, under = image[_mirrored(y - k - 1, height)], image[_mirrored(y + k + 1, height)]
        near, far = taps[radius + k], taps[radius + k + 1]
        for x in range(width):
            inner[x] += near * (above[x] + below[x]) + far * (over[x] + under[x])
    if radius % 2 == 1:
        above, below = image[_mirrored(y - radius, height)], image[_mirrored(y + radius, height)]
        weight = taps[2 * radius]
        for x in range(width):
            inner[x] += weight * (above[x] + below[x])
    for k in range(radius):
        row[radius - 1 - k] = row[radius + _mirrored(k, width)]
        row[radius + width + k] = row[radius + _mirrored(width + k, width)]


@shared("out")
@kernel(fastmath=True)
def blur_difference(since, until, image, fine, coarse, out):
    """Difference of two Gaussian blurs of ``image`` [H, W] float32, borders mirrored.

    ``fine`` and ``coarse`` are symmetric taps of odd length; ``fine`` may be the single tap 1.
    """
    width = image.shape[1]
    small, large = fine.shape[0] // 2, coarse.shape[0] // 2
    for y in range(since, until):
        first = np.empty(width + 2 * small, np.float32)
        second = np.empty(width + 2 * large, np.float32)
        _accumulate_rows(image, y, fine, first)
        _accumulate_rows(image, y, coarse, second)
        line = out[y]
        for x in range(width):
            line[x] = 0
        _add_columns(first, fine, np.float32(1), line)
        _add_columns(second, coarse, np.float32(-1), line)


@woven(fastmath=True)
def _add_columns(row, taps, sign, line):
    """Convolve ``row`` [W + 2 r] with symmetric taps and add the result to ``line`` [W]."""
    width, radius = line.shape[0], taps.shape[0] // 2
    centre, weight = row[radius:], sign * taps[radius]
    for x in range(width):
        line[x] += weight * centre[x]
    for k in range(1, radius, 2):
        left, right = row[radius - k:], row[radius + k:]
        further, beyond = row[radius - k - 1:], row[radius + k + 1:]
        near, far = sign * taps[radius + k], sign * taps[radius + k + 1]
        for x in range(width):
            line[x] += near * (left[x] + right[x]) + far * (further[x] + beyond[x])
    if radius % 2 == 1:
        left, right, weight = row, row[2 * radius:], sign * taps[0]
        for x in range(width):
            line[x] += weight * (left[x] + right[x])


@shared("out")
@kernel
def shrink(since, until, image, factor, out):
    """Means of the blocks of ``factor`` x ``factor`` pixels of ``image`` into ``out`` [h, w].

    ``out`` has ceil(H / factor) rows and ceil(W / factor) columns; the last blocks may be smaller.
    """
    height, width = image.shape
    for j in range(since, until):
        bottom = min((j + 1) * factor, height)
        line = np.zeros(width, np.float32)
        for y in range(j * factor, bottom):
            values = image[y]
            for x in range(width):
                line[x] += values[x]
        for i in range(out.shape[1]):
            right = min((i + 1) * factor, width)
            total = np.float32(0)
            for x in range(i * factor, right):
                total += line[x]
            out[j, i] = total / np.float32((bottom - j * factor) * (right - i * factor))


@shared("counts")
@lean_kernel
def count_values(since, until, values, inside, level, reach, counts):
    """Histogram of the ``values`` [H, W] where ``inside`` [H, W] exceeds ``level``.

    ``counts`` int64 [threads, bins] gets one histogram per block of rows, over [-reach, reach].
    Values beyond count in the outermost bins.
    """
    height, width = values.shape
    blocks, bins = counts.shape
    scale = np.float32(bins) / (np.float32(2) * reach)
    for block in range(since, until):
        for y in range(block * height // blocks, (block + 1) * height // blocks):
            for x in range(width):
                if inside[y, x] > level:
                    n = np.int64((values[y, x] + reach) * scale)
                    counts[block, min(max(n, 0), bins - 1)] += 1


@shared("values")
@lean_kernel
def map_values(since, until, values, table, reach):
    """Replace ``values`` [H, W] in place by the piecewise linear ``table`` over [-reach, reach]."""
    width = values.shape[1]
    bins = table.shape[0] - 1
    scale = np.float32(bins) / (np.float32(2) * reach)
    for y in range(since, until):
        for x in range(width):
            index = min(max((values[y, x] + reach) * scale, np.float32(0)), np.float32(bins))
            low = min(np.int64(index), bins - 1)
            values[y, x] = table[low] + (index - np.float32(low)) * (table[low + 1] - table[low])


@shared("out")
@lean_kernel
def stretch(since, until, position, anchor, least, cell, out):
    """Steps of ``position`` [H, W, 2] over those of ``anchor``, the smaller of along x and along y.

    ``out`` float32 [h, w] in [``least``, 1], one value for each ``cell`` x ``cell`` pixels, from
    that in its middle; 1 where a step is not known.
    """
    height, width = position.shape[:2]
    for j in range(since, until):
        y = min(j * cell + cell // 2, height - 1)
        for i in range(out.shape[1]):
            x = min(i * cell + cell // 2, width - 1)
            ratio = np.float32(1)
            for axis in range(2):
                v, u = min(y + axis, height - 1), min(x + 1 - axis, width - 1)
                px = position[v, u, 0] - position[y, x, 0]
                py = position[v, u, 1] - position[y, x, 1]
                ax, ay = anchor[v, u, 0] - anchor[y, x, 0], anchor[v, u, 1] - anchor[y, x, 1]
                moved, steady = px * px + py * py, ax * ax + ay * ay
                # Comparisons with NaN are false, and so is this one at the borders.
                if moved < ratio * ratio * steady:
                    ratio = np.sqrt(moved / steady)
            out[j, i] = max(ratio, least)


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
    nodes : float32 [h, w, 2], places in exemplar pixels.
    wanted : float32 [h, w], signed distance from the target's edge, in exemplar pixels.
    style : float32 [H, W], the exemplar's signed distances in pixels, one value a cell.
    cell : Side of a cell of ``style`` in pixels.
    reach : The move fades over this distance from the edge (Gaussian sigma).
    most : And where the distances disagree by more than about this: other edges are meant.
    keep : What is inside ends up inside by half the wanted distance or by this one, whichever is
        less, and what is outside likewise outside; 0 lets it lie where it does.
    rounds : Steps towards the wanted distance.
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
