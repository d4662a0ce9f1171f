"""Loops over the sub-pixels of a panel: their views, coding of views and of a field, taking apart.

A field is coded by one ray per sub-pixel, of which only its own channel is evaluated.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ...arrays import Float64
from ...field.marching import (
    enter_box,
    make_channel_shade,
    make_detail,
    make_march,
    make_texture_share,
    sh_basis,
)
from ...simd.decorators import identified, kernel, lean, lean_kernel
from ...simd.threads import share_out, shared
from ...simd.vectors import LANES


def lens_of(display: Any) -> Float64:
    """The numbers of a `Display` that the kernels take as ``lens``."""
    return np.array([display.pitch, display.shift, display.offset, display.views,
                     display.inverted, display.aspect, display.breadth], np.float64)


@lean
def _view(y, x, k, steps, lens):
    """Fractional view in [0, V) of a sub-pixel; the same operations as `Display.view_of`."""
    raw = 3.0 * x + steps[y % 4, x % 2, k] + y * lens[1] + lens[2]
    phase = raw - lens[0] * np.floor(raw / lens[0])
    if phase >= lens[0]:
        phase = 0.0
    if lens[4] > 0.5 and phase > 0:
        phase = lens[0] - phase
    return phase * (lens[3] / lens[0])


@shared("mask")
@lean_kernel
def mask_views(since, until, mask, steps, lens, first, apart):
    """Fill ``mask`` [H, W, 3] with the nearest view of every sub-pixel.

    Its rows are those of the panel from ``first`` on, ``apart`` from each other.
    """
    width, _ = mask.shape[1:]
    last = int(lens[3]) - 1
    for y in range(since, until):
        for x in range(width):
            for k in range(3):
                mask[y, x, k] = min(int(_view(first + y * apart, x, k, steps, lens)), last)


def mix_light(pictures, light, gamma):
    """The mean of pictures uint8 [n, h, w] as light, in place of the first one.

    ``light`` float64 [256] is that of each stored value, (value / 255) ** gamma.
    """
    _mix_rows(pictures, light, gamma, pictures[0])


@shared("out")
@lean_kernel
def _mix_rows(since, until, pictures, light, gamma, out):
    """`mix_light` of some rows, into ``out``, the first picture."""
    count, width = len(pictures), out.shape[1]
    for y in range(since, until):
        for x in range(width):
            first = pictures[0, y, x]
            total, same = light[first], True
            for n in range(1, count):
                same = same and pictures[n, y, x] == first
                total += light[pictures[n, y, x]]
            if not same:
                mean = (total / count) ** (1.0 / gamma)
                out[y, x] = np.uint8(mean * 255.0 + 0.5)


@lean
def _sample(views, view, top, left, channel, linear):
    """A view's picture at a place in its pixels; its border is repeated outside of it."""
    height, width = views.shape[1], views.shape[2]
    if not linear:
        row = min(max(int(np.floor(top)), 0), height - 1)
        column = min(max(int(np.floor(left)), 0), width - 1)
        return float(views[view, row, column, channel])
    row, column = np.floor(top - 0.5), np.floor(left - 0.5)
    down, right = top - 0.5 - row, left - 0.5 - column
    y0, x0 = min(max(int(row), 0), height - 1), min(max(int(column), 0), width - 1)
    y1, x1 = min(max(int(row) + 1, 0), height - 1), min(max(int(column) + 1, 0), width - 1)
    upper = (1 - right) * views[view, y0, x0, channel] + right * views[view, y0, x1, channel]
    lower = (1 - right) * views[view, y1, x0, channel] + right * views[view, y1, x1, channel]
    return (1 - down) * upper + down * lower


@shared("out")
@lean_kernel
def interlace_views(since, until, views, steps, places, order, lens, window, linear, blend, out):
    """Code pictures of views for a panel.

    Parameters
    ----------
    views : uint8 [V, h, w, 3], view 0 leftmost; V need not be the panel's number of views.
    steps, places, order, lens : The panel; ``order`` int64 [3] is the color of each sub-pixel.
    window : float64 [3]: width and height of the pictures over the panel's; shift of the last
        view against the middle one, in panel widths to the right.
    linear, blend : Whether pictures are interpolated between their pixels, and views between
        their neighbours.
    out : uint8 [H, W, 3].
    """
    height, width, _ = out.shape
    count, rows, columns = views.shape[0], views.shape[1], views.shape[2]
    for y in range(since, until):
        for x in range(width):
            for k in range(3):
                channel = order[k]
                across = (x + places[y % 4, x % 2, k, 0]) / width - 0.5
                down = (y + places[y % 4, x % 2, k, 1]) / height - 0.5
                if abs(across) > 0.5 * window[0] or abs(down) > 0.5 * window[1]:
                    out[y, x, channel] = 0
                    continue
                place = _view(y, x, k, steps, lens) * (count / lens[3])
                nearest = min(int(place), count - 1)
                first = nearest
                share = 0.0
                if blend:
                    inside = min(max(place - 0.5, 0.0), count - 1.0)
                    first = min(int(inside), max(count - 2, 0))
                    share = inside - first
                value = 0.0
                top = (down / window[1] + 0.5) * rows
                for other in range(2):
                    weight = share if other else 1.0 - share
                    if weight <= 0.0:
                        continue
                    view = min(first + other, count - 1)
                    turn = window[2] * (2.0 * (view + 0.5) / count - 1.0)
                    left = ((across + turn) / window[0] + 0.5) * columns
                    value += weight * _sample(views, view, top, left, channel, linear)
                out[y, x, channel] = np.uint8(min(max(value, 0.0), 255.0) + 0.5)


def gather_views(image, steps, places, order, lens, count, first, value, weight):
    """Collect the sub-pixels of a coded picture by their views.

    Parameters
    ----------
    image : uint8 [H, W, 3].
    steps, places, order, lens : As for `interlace_views`.
    count, first : Number of views that the panel's are spread over; number of the first one
        wanted.
    value, weight : float32 [n, h, w, 3], zero at first: sums over the sub-pixels that fall on a
        pixel of view ``first`` + i. A view's own count 1, others' within one sub-pixel's step
        next to nothing: they decide only where there is none of its own.
    """
    share_out(_gather_rows, value.shape[1], image, steps, places, order, lens, count, first, value,
              weight)


@lean_kernel
def _gather_rows(since, until, image, steps, places, order, lens, count, first, value, weight):
    """`gather_views` of some rows of the views."""
    height, width, _ = image.shape
    wanted, rows, columns = value.shape[0], value.shape[1], value.shape[2]
    reach = 0.5 + max(count / lens[0], 1.0)
    for row in range(since, until):
        start = max(int(np.floor(row * height / rows)) - 1, 0)
        stop = min(int(np.ceil((row + 1) * height / rows)) + 1, height)
        for y in range(start, stop):
            for x in range(width):
                for k in range(3):
                    if int((y + places[y % 4, x % 2, k, 1]) * rows / height) != row:
                        continue
                    column = int((x + places[y % 4, x % 2, k, 0]) * columns / width)
                    if column < 0 or column >= columns:
                        continue
                    channel = order[k]
                    shown = min(np.floor(_view(y, x, k, steps, lens)), lens[3] - 1) + 0.5
                    place = shown * count / lens[3]
                    own = min(int(place), count - 1)
                    low = max(int(np.ceil(place - 0.5 - reach)), first)
                    high = min(int(np.floor(place - 0.5 + reach)), first + wanted - 1)
                    for view in range(low, high + 1):
                        share = 1.0
                        if view != own:
                            near = 1.0 - abs(view + 0.5 - place) / (reach + 0.5)
                            share = 1e-4 * near * near
                        value[view - first, row, column, channel] += share * image[y, x, channel]
                        weight[view - first, row, column, channel] += share


@lean
def _aim(image, light, y, place, channel, wanted, steps, lens, crosstalk, sigma, reach, weight,
         value):
    """How nearly a row's sub-pixels are aimed at the eye, and that times their light."""
    aperture = lens[3] / lens[0]
    for x in range(image.shape[1]):
        # A sub-pixel shows its nearest view, seen as if from the middle of that view.
        view = min(np.floor(_view(y, x, place, steps, lens)), lens[3] - 1) + 0.5
        away = abs(view - wanted[3 * x + place])
        if crosstalk <= 0:
            sharp = max(0.0, 1.0 - away / (1.5 * aperture))
            # Next to nothing, so that a place without any near sub-pixel is not black.
            far = 1.0 + (away / aperture) ** 2
            share = sharp * sharp + 1e-6 / (far * far)
        else:
            away = min(away, lens[3] - away)
            share = np.exp(-0.5 * (away / sigma) ** 2)
        weight[x + reach] = share
        value[x + reach] = share * light[image[y, x, channel]]


@shared("out")
@kernel
def see_panel(since, until, image, light, wanted, order, steps, lens, crosstalk, block, out):
    """An eye's view: sub-pixels weighted by how nearly they are aimed at it, filled in by rows.

    Parameters
    ----------
    image : uint8 [H, W, 3], the coded picture.
    light : float32 [256], light of each stored value.
    wanted : float64 [W * 3]: the view that the eye receives at each place of a row.
    order, steps, lens : The panel.
    crosstalk : Sigma in views of the lobe with which other views leak in; 0 = none.
    block : Side of the blocks of pixels whose mean is taken.
    out : float32 [H // block, W // block, 3].
    """
    width = image.shape[1]
    pitch, aperture = lens[0], lens[3] / lens[0] * lens[6]
    reach = max(1, int(np.ceil(pitch / 1.5)))
    sigma = np.hypot(crosstalk, 0.5 * aperture)
    window = np.empty(2 * reach + 1, np.float32)
    for i in range(2 * reach + 1):
        window[i] = np.exp(-0.5 * ((i - reach) / (pitch / 6.0)) ** 2)
    share = np.float32(1.0 / (block * block))
    # Beyond the ends of a row there is nothing.
    weight = np.zeros(width + 2 * reach, np.float32)
    value = np.zeros(width + 2 * reach, np.float32)
    top, mass = np.empty(width, np.float32), np.empty(width, np.float32)
    for line in range(since, until):
        out[line] = np.float32(0.0)
        for y in range(line * block, line * block + block):
            for place in range(3):
                channel = order[place]
                _aim(image, light, y, place, channel, wanted, steps, lens, crosstalk, sigma, reach,
                     weight, value)
                top[:] = np.float32(0.0)
                mass[:] = np.float32(1e-30)
                for i in range(2 * reach + 1):
                    near = window[i]
                    for x in range(width):
                        top[x] += near * value[x + i]
                        mass[x] += near * weight[x + i]
                for column in range(out.shape[1]):
                    total = np.float32(0.0)
                    for x in range(column * block, column * block + block):
                        total += top[x] / mass[x]
                    out[line, column, channel] += share * total


@identified("eye_of")
@lean_kernel
def eye_of(place, y, eyes, panel):
    """Eye of sub-pixel ``place`` of row ``y`` at its own phase, between two views."""
    column, k = place // 3, place % 3
    step = panel[13 + 6 * (y % 4) + 3 * (column % 2) + k]
    raw = 3.0 * column + step + y * panel[10] + panel[11]
    phase = raw - panel[9] * np.floor(raw / panel[9])
    if phase >= panel[9]:
        phase = 0.0
    if panel[12] > 0.5 and phase > 0:
        phase = panel[9] - phase
    last = len(eyes) - 1
    at = min(max(phase / panel[9] * len(eyes) - 0.5, 0.0), float(last))
    return eyes[0] + (eyes[last] - eyes[0]) * at / max(last, 1)


@identified("side_of")
@lean_kernel
def side_of(place, y, across, panel):
    """X on the panel, in half panel heights, of sub-pixel ``place`` of row ``y``."""
    moved = panel[37 + 6 * (y % 4) + 3 * (place // 3 % 2) + place % 3]
    return panel[0] * (2.0 * (place + 0.5 + moved) / across - 1.0)


@functools.cache
def encode_kernel(width: int, count: int) -> Callable[..., Any]:
    """The kernel for color rows of 16 or 32 with ``count`` coefficients a channel.

    ``encode(table, links, density, rows, cells, charts, texels, lattice, matrix, axes, mask, fixed,
    eyes, panel, step, threshold, stop, background, out)``. ``cells``, ``charts`` and ``texels`` are
    the field's texture (`VoxelField.texture_rows`). ``matrix`` float64 [3, 4] takes the display
    frame to lattice coordinates, ``axes`` float64 [2, 3] are its x and z axes in the field's world
    (y is up in both). ``mask`` [H, W * 3] holds each sub-pixel's view; ``fixed`` >= 0 overrides it
    with one view; where ``eyes`` has one entry a sub-pixel phase instead (``panel[6]`` > 0), the
    view is continuous. ``panel`` float64 [61]: half width over half height, eye height, distance
    and placement scale, packed as [aspect, eye_y, distance, scale, first, rows, continuous, apart,
    bgr, pitch, shift, offset, inverted]; then, for each row mod 4, column mod 2 and sub-pixel, its
    phase in its pixel (`Display.steps`), and how far it lies to the right of its usual third of the
    pixel, in sub-pixels. ``out`` uint8 [H, W * 3]. Its rows are those of the panel from ``first``
    on, ``apart`` from each other; the panel has ``rows`` of them. Where ``background`` is below 0
    it holds what is behind the field.
    """
    march = make_march(LANES, make_channel_shade(width, count))
    look_up, texture_share = make_detail(LANES, False), make_texture_share(LANES)
    load, store, ints = LANES.load, LANES.store, LANES.ints
    where, floats = LANES.where, LANES.floats

    @shared("out")
    @identified("encode", width, count)
    @kernel
    def encode(since, until, table, links, density, rows, cells, charts, texels, lattice, matrix,
               axes, mask, fixed, eyes, panel, step, threshold, stop, background, out):
        across = mask.shape[1]
        nx, ny, nz = np.int32(lattice[0]), np.int32(lattice[1]), np.int32(lattice[2])
        eye_y, distance, size = panel[1], panel[2], panel[3]
        continuous, bgr = panel[6] > 0.5, panel[8] > 0.5
        for y in range(since, until):
            basis = np.zeros(16 * 64, np.float32)
            scratch = np.zeros(16, np.float32)
            ray = np.zeros((10, 16), np.float32)
            flat = ray.reshape(160)
            line = int(panel[4]) + y * int(panel[7])
            py = 1.0 - 2.0 * (line + 0.5) / panel[5]
            for first in range(0, across, 16):
                for i in range(16):
                    place = min(first + i, across - 1)
                    if fixed >= 0:
                        ex = eyes[fixed]
                    elif continuous:
                        ex = eye_of(place, line, eyes, panel)
                    else:
                        ex = eyes[mask[y, place]]
                    px = side_of(place, line, across, panel)
                    wx, wy, wz = px - ex, py - eye_y, -distance
                    scale = 1.0 / np.sqrt(wx * wx + wy * wy + wz * wz)
                    wx, wy, wz = wx * scale, wy * scale, wz * scale
                    if count > 1:
                        sh_basis(np.float32(wx * axes[0, 0] + wz * axes[1, 0]), np.float32(wy),
                                 np.float32(wx * axes[0, 2] + wz * axes[1, 2]), scratch, 0, count)
                        for j in range(count):
                            basis[64 * i + j] = scratch[j]
                    else:
                        basis[64 * i] = np.float32(0.28209479177387814)
                    # Display frame to the field's lattice.
                    ox = matrix[0, 0] * ex + matrix[0, 2] * distance + matrix[0, 3]
                    oy = matrix[1, 1] * eye_y + matrix[1, 3]
                    oz = matrix[2, 0] * ex + matrix[2, 2] * distance + matrix[2, 3]
                    gx = matrix[0, 0] * wx + matrix[0, 2] * wz
                    gy = matrix[1, 1] * wy
                    gz = matrix[2, 0] * wx + matrix[2, 2] * wz
                    norm = np.sqrt(gx * gx + gy * gy + gz * gz)
                    dx, dy, dz = np.float32(gx / norm), np.float32(gy / norm), np.float32(gz / norm)
                    start, end = enter_box(np.float32(ox), np.float32(oy), np.float32(oz), dx, dy,
                                           dz, nx, ny, nz)
                    ray[0, i], ray[1, i], ray[2, i] = ox, oy, oz
                    ray[3, i], ray[4, i], ray[5, i] = dx, dy, dz
                    ray[6, i], ray[7, i] = start, end
                    ray[8, i] = np.float32(step / (norm * size))
                    channel = place % 3
                    ray[9, i] = np.float32(2 - channel if bgr else channel)
                value, _, _, through, where_half = march(
                    table, links, density, rows, nx, ny, nz, load(flat, 0), load(flat, 16),
                    load(flat, 32), load(flat, 48), load(flat, 64), load(flat, 80), load(flat, 96),
                    load(flat, 112), np.float32(step), load(flat, 128), np.float32(threshold),
                    np.float32(stop), basis, load(flat, 144))
                if len(cells) > 0:
                    share = texture_share(through)
                    wanted = share > np.float32(0.0)
                    # Without a surface it is infinite.
                    where_half = where(wanted, where_half, floats(np.float32(0.0)))
                    detail, _, _ = look_up(
                        table, cells, charts, texels, nx, ny, nz,
                        load(flat, 0) + where_half * load(flat, 48),
                        load(flat, 16) + where_half * load(flat, 64),
                        load(flat, 32) + where_half * load(flat, 80),
                        wanted, ints(load(flat, 144)))
                    value = value + share * detail
                store(flat, 0, value)
                store(flat, 16, through)
                for i in range(min(16, across - first)):
                    behind = background
                    if background < np.float32(0.0):
                        behind = np.float32(out[y, first + i]) * np.float32(1.0 / 255.0)
                    shown = ray[0, i] + ray[1, i] * behind
                    shown = min(max(shown, np.float32(0.0)), np.float32(1.0))
                    out[y, first + i] = np.uint8(shown * np.float32(255.0) + np.float32(0.5))
    return encode
