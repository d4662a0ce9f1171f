"""Kernels of what is shared: splats fitted and drawn, colors of a page's pieces."""

import math

import numpy as np

from ..simd.decorators import kernel, lean_kernel
from ..simd.threads import shared

TILE = 16  # Side of a tile in pixels.
COLUMNS = 8
"""Of a projected splat: middle x, y; inverse covariance xx, xy, yy; opacity; half width, height."""
LEAST = np.float32(1 / 255)
MOST = np.float32(0.99)
DARK = np.float32(1e-4)  # A pixel whose transmittance is lower is finished.


@shared("positions")
@lean_kernel
def project(first, last, positions, scales, axes, opacity, camera, size, flat, depth):
    """Project splats into a picture.

    Parameters
    ----------
    positions, scales : float32 [N, 3], in the world; standard deviations along the axes.
    axes : float32 [N, 3, 3], the axes' directions as columns.
    opacity : float32 [N].
    camera : float64 [16], see `lfportrait.Camera.row`.
    size : Width and height in pixels.
    flat : float32 [N, COLUMNS] out.
    depth : float32 [N] out, along the optical axis; infinite for splats that are not in the
        picture.
    """
    width, height = size
    # Beyond the picture's border the approximation of the perspective is held.
    far_x = 1.3 * max(camera[14], width - camera[14]) / camera[12]
    far_y = 1.3 * max(camera[15], height - camera[15]) / camera[13]
    for n in range(first, last):
        depth[n] = np.inf
        dx = positions[n, 0] - camera[3]
        dy = positions[n, 1] - camera[7]
        dz = positions[n, 2] - camera[11]
        z = camera[2] * dx + camera[6] * dy + camera[10] * dz
        if z < 0.05 or opacity[n] < LEAST:
            continue
        x = (camera[0] * dx + camera[4] * dy + camera[8] * dz) / z
        y = (camera[1] * dx + camera[5] * dy + camera[9] * dz) / z
        bent_x, bent_y = min(max(x, -far_x), far_x), min(max(y, -far_y), far_y)
        # Pixels squared: so no splat falls between pixels.
        xx, xy, yy = 0.3, 0.0, 0.3
        for k in range(3):
            u, v = _seen_axis(axes, n, k, camera, bent_x, bent_y, z)
            variance = scales[n, k] * scales[n, k]
            xx += variance * u * u
            xy += variance * u * v
            yy += variance * v * v
        area = xx * yy - xy * xy
        reach = 2.0 * math.log(255.0 * opacity[n])
        px, py = camera[12] * x + camera[14], camera[13] * y + camera[15]
        half_x, half_y = math.sqrt(reach * xx), math.sqrt(reach * yy)
        if (area <= 0.0 or px + half_x < 0.0 or px - half_x > width or py + half_y < 0.0
                or py - half_y > height):
            continue
        depth[n] = z
        flat[n, 0], flat[n, 1] = px, py
        flat[n, 2], flat[n, 3], flat[n, 4] = yy / area, -xy / area, xx / area
        flat[n, 5], flat[n, 6], flat[n, 7] = opacity[n], half_x, half_y


@kernel
def _seen_axis(axes, n, k, camera, x, y, z):
    """How many pixels an axis of unit length spans, to the right and down."""
    a, b, c = axes[n, 0, k], axes[n, 1, k], axes[n, 2, k]
    right = camera[0] * a + camera[4] * b + camera[8] * c
    down = camera[1] * a + camera[5] * b + camera[9] * c
    forward = camera[2] * a + camera[6] * b + camera[10] * c
    return camera[12] / z * (right - x * forward), camera[13] / z * (down - y * forward)


@kernel
def _tiles(flat, n, size):
    """The tiles that a splat touches: first and last column and row, the last ones excluded."""
    width, height = size
    left = max(math.floor(flat[n, 0] - flat[n, 6]), 0) // TILE
    top = max(math.floor(flat[n, 1] - flat[n, 7]), 0) // TILE
    right = min(math.floor(flat[n, 0] + flat[n, 6]), width - 1) // TILE + 1
    bottom = min(math.floor(flat[n, 1] + flat[n, 7]), height - 1) // TILE + 1
    return left, right, top, bottom


@kernel
def fill_tiles(flat, order, size):
    """Lists of the splats that touch each tile, from front to back.

    ``flat`` float32 [N, COLUMNS]; ``order`` int64 [M], splats in the picture from front to back;
    ``size``, width and height in pixels. Returns int64 [T + 1], where each tile's list begins, and
    int32 [P], splats.
    """
    across, down = -(-size[0] // TILE), -(-size[1] // TILE)
    starts = np.zeros(across * down + 1, np.int64)
    for n in order:
        left, right, top, bottom = _tiles(flat, n, size)
        for row in range(top, bottom):
            for column in range(left, right):
                starts[row * across + column + 1] += 1
    for tile in range(across * down):
        starts[tile + 1] += starts[tile]
    at = starts[:-1].copy()
    members = np.empty(starts[-1], np.int32)
    for n in order:
        left, right, top, bottom = _tiles(flat, n, size)
        for row in range(top, bottom):
            for column in range(left, right):
                tile = row * across + column
                members[at[tile]] = n
                at[tile] += 1
    return starts, members


@kernel
def _box(flat, n, x0, y0, x1, y1):
    """Pixels of a part of the picture whose middles a splat may reach."""
    left = max(math.ceil(flat[n, 0] - flat[n, 6] - 0.5), x0)
    right = min(math.floor(flat[n, 0] + flat[n, 6] - 0.5) + 1, x1)
    top = max(math.ceil(flat[n, 1] - flat[n, 7] - 0.5), y0)
    bottom = min(math.floor(flat[n, 1] + flat[n, 7] - 0.5) + 1, y1)
    return left, right, top, bottom


@shared("tiles")
@kernel
def composite(first, last, tiles, flat, colors, starts, members, image):
    """Composite the splats of tiles ``first`` to ``last`` of ``tiles``.

    ``colors`` float32 [N, 3] are the splats' as this picture shows them; ``image`` float32
    [H, W, 4] is color times alpha, and transmittance, out.
    """
    height, width, _ = image.shape
    across = -(-width // TILE)
    for tile in range(first, last):
        y0, x0 = tile // across * TILE, tile % across * TILE
        y1, x1 = min(y0 + TILE, height), min(x0 + TILE, width)
        image[y0:y1, x0:x1, :3] = np.float32(0)
        image[y0:y1, x0:x1, 3] = np.float32(1)
        open_pixels = (y1 - y0) * (x1 - x0)
        for member in range(starts[tile], starts[tile + 1]):
            if open_pixels == 0:
                break
            n = members[member]
            left, right, top, bottom = _box(flat, n, x0, y0, x1, y1)
            red, green, blue = colors[n, 0], colors[n, 1], colors[n, 2]
            for y in range(top, bottom):
                down = flat[n, 1] - np.float32(y + 0.5)
                for x in range(left, right):
                    through = image[y, x, 3]
                    if through < DARK:
                        continue
                    side = flat[n, 0] - np.float32(x + 0.5)
                    power = (np.float32(-0.5) * (flat[n, 2] * side * side
                                                 + flat[n, 4] * down * down)
                             - flat[n, 3] * side * down)
                    alpha = min(flat[n, 5] * math.exp(power), MOST)
                    if alpha < LEAST:
                        continue
                    weight = through * alpha
                    image[y, x, 0] += weight * red
                    image[y, x, 1] += weight * green
                    image[y, x, 2] += weight * blue
                    through -= weight
                    image[y, x, 3] = through
                    if through < DARK:
                        open_pixels -= 1


@shared("tiles")
@kernel
def differentiate(first, last, tiles, flat, colors, starts, members, image, slope, pairs):
    """What a change of each splat changes, for tiles ``first`` to ``last`` of ``tiles``.

    Parameters
    ----------
    image : float32 [H, W, 4], as `composite` left it.
    slope : float32 [H, W, 4], derivative of the loss by ``image``.
    pairs : float32 [P, 10] out, for each member of a tile's list: derivatives by the color, the
        opacity, the inverse covariance and the middle; its weight in the picture.
    """
    height, width, _ = image.shape
    across = -(-width // TILE)
    through = np.empty((TILE, TILE), np.float32)
    behind = np.empty((TILE, TILE), np.float32)
    for tile in range(first, last):
        y0, x0 = tile // across * TILE, tile % across * TILE
        y1, x1 = min(y0 + TILE, height), min(x0 + TILE, width)
        open_pixels = (y1 - y0) * (x1 - x0)
        for y in range(y0, y1):
            for x in range(x0, x1):
                through[y - y0, x - x0] = np.float32(1)
                # Sum over the splats behind, of their share of the loss; less and less below.
                behind[y - y0, x - x0] = (image[y, x, 0] * slope[y, x, 0]
                                          + image[y, x, 1] * slope[y, x, 1]
                                          + image[y, x, 2] * slope[y, x, 2])
        for member in range(starts[tile], starts[tile + 1]):
            for k in range(10):
                pairs[member, k] = np.float32(0)
            if open_pixels == 0:
                continue
            n = members[member]
            left, right, top, bottom = _box(flat, n, x0, y0, x1, y1)
            for y in range(top, bottom):
                down = flat[n, 1] - np.float32(y + 0.5)
                for x in range(left, right):
                    left_over = through[y - y0, x - x0]
                    if left_over < DARK:
                        continue
                    side = flat[n, 0] - np.float32(x + 0.5)
                    power = (np.float32(-0.5) * (flat[n, 2] * side * side
                                                 + flat[n, 4] * down * down)
                             - flat[n, 3] * side * down)
                    shape = np.float32(math.exp(power))
                    alpha = min(flat[n, 5] * shape, MOST)
                    if alpha < LEAST:
                        continue
                    weight = left_over * alpha
                    share = (colors[n, 0] * slope[y, x, 0] + colors[n, 1] * slope[y, x, 1]
                             + colors[n, 2] * slope[y, x, 2])
                    rest = behind[y - y0, x - x0] - weight * share
                    # What is behind, the transmittance with it, is dimmed by alpha.
                    by_alpha = left_over * share - (
                        rest + image[y, x, 3] * slope[y, x, 3]) / (np.float32(1) - alpha)
                    behind[y - y0, x - x0] = rest
                    through[y - y0, x - x0] = left_over - weight
                    if left_over - weight < DARK:
                        open_pixels -= 1
                    pairs[member, 0] += weight * slope[y, x, 0]
                    pairs[member, 1] += weight * slope[y, x, 1]
                    pairs[member, 2] += weight * slope[y, x, 2]
                    pairs[member, 9] += weight
                    if alpha >= MOST:
                        continue
                    pairs[member, 3] += by_alpha * shape
                    by_power = by_alpha * alpha
                    pairs[member, 4] -= np.float32(0.5) * by_power * side * side
                    pairs[member, 5] -= by_power * side * down
                    pairs[member, 6] -= np.float32(0.5) * by_power * down * down
                    pairs[member, 7] -= by_power * (flat[n, 2] * side + flat[n, 3] * down)
                    pairs[member, 8] -= by_power * (flat[n, 3] * side + flat[n, 4] * down)


@kernel
def pull(pairs, members, order, positions, scales, axes, camera, flat, out):
    """Derivatives by the splats themselves, from those of `differentiate`.

    ``out`` float32 [N, 11]: by the color (3), the opacity, the logarithms of the scales (3), the
    position (3, by the middle's place in the picture alone); the weight in the picture, 0 for
    splats that are hidden or not in ``order``.
    """
    sums = np.zeros((len(positions), 10), np.float32)
    for member in range(len(members)):
        if pairs[member, 9] == 0:
            continue  # hidden
        n = members[member]
        for k in range(10):
            sums[n, k] += pairs[member, k]
    out[:] = 0
    for n in order:
        if sums[n, 9] == 0:
            continue
        out[n, 10] = sums[n, 9]
        for k in range(4):
            out[n, k] = sums[n, k]
        a, b, c = flat[n, 2], flat[n, 3], flat[n, 4]
        # By the covariance: - Q G Q, where Q is its inverse and G the derivative by that.
        g, h, i = sums[n, 4], np.float32(0.5) * sums[n, 5], sums[n, 6]
        xx = -(a * a * g + 2 * a * b * h + b * b * i)
        xy = -(a * b * g + (a * c + b * b) * h + b * c * i)
        yy = -(b * b * g + 2 * b * c * h + c * c * i)
        dx = positions[n, 0] - camera[3]
        dy = positions[n, 1] - camera[7]
        dz = positions[n, 2] - camera[11]
        z = camera[2] * dx + camera[6] * dy + camera[10] * dz
        x = (camera[0] * dx + camera[4] * dy + camera[8] * dz) / z
        y = (camera[1] * dx + camera[5] * dy + camera[9] * dz) / z
        for k in range(3):
            u, v = _seen_axis(axes, n, k, camera, x, y, z)
            out[n, 4 + k] = 2 * scales[n, k] * scales[n, k] * (
                xx * u * u + 2 * xy * u * v + yy * v * v)
        right = camera[12] / z * sums[n, 7]
        down = camera[13] / z * sums[n, 8]
        forward = -(x * right + y * down)
        for k in range(3):
            out[n, 7 + k] = (camera[4 * k] * right + camera[4 * k + 1] * down
                             + camera[4 * k + 2] * forward)


@kernel
def code_rows(filled, values, tolerance, residual, decoded):
    """Code the rows of a lattice.

    Parameters
    ----------
    filled : bool [Z, Y, X], where rows are; they are numbered in this order, x fastest.
    values : uint8 [N, C]. The channels after the first are corrected by what the first one's
        guess lacked: colors rise and fall together.
    tolerance : uint8 [N], the largest error of each row.
    residual : uint8 [C, N] out: what the guesses lack, modulo 256.
    decoded : uint8 [N, C] out: the values as they are read back.
    """
    planes, rows, columns = filled.shape
    channels = values.shape[1]
    before = np.full((rows, columns), -1, np.int32)
    here = np.full((rows, columns), -1, np.int32)
    number = 0
    for k in range(planes):
        for j in range(rows):
            for i in range(columns):
                if not filled[k, j, i]:
                    here[j, i] = -1
                    continue
                left = here[j, i - 1] if i > 0 else -1
                above = here[j - 1, i] if j > 0 else -1
                deep = before[j, i]
                step = 2 * np.int32(tolerance[number]) + 1
                correction = 0
                for channel in range(channels):
                    total, count = 0, 0
                    if left >= 0:
                        total += np.int32(decoded[left, channel])
                        count += 1
                    if above >= 0:
                        total += np.int32(decoded[above, channel])
                        count += 1
                    if deep >= 0:
                        total += np.int32(decoded[deep, channel])
                        count += 1
                    guess = (2 * total + count) // (2 * count) if count > 0 else 128
                    guess = min(max(guess + correction, 0), 255)
                    lack = np.int32(values[number, channel]) - guess
                    times = (abs(lack) + step // 2) // step
                    shown = guess + (times * step if lack >= 0 else -times * step)
                    shown = min(max(shown, 0), 255)
                    decoded[number, channel] = shown
                    residual[channel, number] = np.uint8((shown - guess) & 255)
                    if channel == 0:
                        correction = shown - guess
                here[j, i] = number
                number += 1
        before, here = here, before
