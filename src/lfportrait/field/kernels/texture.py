"""Looking up the texture of a field's surface where a ray meets it.

A texture (`lfportrait.field.texture`) is a few far pictures side by side. Which of them shows a
place is kept for each cell of the lattice, in the layout that rays are cast through (`bricks`), so
that a ray's end needs no search: its cell names the chart, a projection gives the place there.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...simd.decorators import identified, kernel, lean
from ...simd.threads import share_out, shared
from ...simd.vectors import LANES
from .march import make_locate

NONE = 255  # The chart of a row that none shows; a cell's is -1.
PROBES = 8  # Look-ups of a pixel, at most, where it sees a long piece of surface.
REACH = 1.7
"""Width of the detail along a pixel's piece of surface, over that piece; across it is `TEXEL` of
`grid`. Squares of widths add up: what one look-up blurs counts, too."""


@shared("brick_links", per=128)
@kernel
def cell_charts(since, until, brick_links, charts, out):
    """The chart that most corners of a cell name, int32 [bricks * 128]; -1 where none does.

    ``charts`` uint8 [N + 1] has the charts of the lattice's rows, `NONE` for the last one, which
    stands for empty points. Of the slots of a brick only those that begin a cell are used.
    """
    names = np.empty(8, np.int64)
    for brick in range(since, until):
        for slot in range(128):
            out[brick * 128 + slot] = -1
        for cell in range(64):
            low = brick * 128 + (cell >> 4) * 25 + ((cell >> 2) & 3) * 5 + (cell & 3)
            for corner in range(8):
                offset = (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1)
                names[corner] = charts[brick_links[low + offset]]
            most = 0
            for corner in range(8):
                count = 0
                for other in range(8):
                    count += names[other] == names[corner]
                if names[corner] != NONE and count > most:
                    most = count
                    out[low] = names[corner]


def make_texture_share(lanes: SimpleNamespace) -> Callable[..., Any]:
    """Make the function that gives the texture's share of a ray's color, by its transmittance.

    All of it where they are nearly opaque. Where half the light passes there is no surface; up to
    there it fades, so that nothing begins with a step. Below that it is negative: take none.
    """
    minimum = lanes.minimum

    @identified("texture share", lanes.width)
    @lanes.jit
    def texture_share(through):
        return minimum(np.float32(2.0) - np.float32(4.0) * through, np.float32(1.0))
    return texture_share


def make_chart_of(lanes: SimpleNamespace) -> Callable[..., Any]:
    """The function that names the charts of places.

    Returns
    -------
    chart_of : ``chart_of(table, cells, nx, ny, nz, x, y, z)``: lanes of int, -1 where no chart
        shows the place. ``table`` is that of `Bricks`, ``cells`` int32 [bricks * 128] the
        charts of its cells (`cell_charts`); x, y, z are lattice coordinates.
    """
    gather, where, ints, maximum = lanes.gather, lanes.where, lanes.ints, lanes.maximum
    locate = make_locate(lanes)

    @identified("chart of", lanes.width)
    @lanes.jit
    def chart_of(table, cells, nx, ny, nz, x, y, z):
        brick, _, _, _, inner, _, _, _ = locate(table, x, y, z, nx, ny, nz)
        chart = gather(cells, maximum(brick, np.int32(0)) * np.int32(128) + inner)
        return where(brick >= np.int32(0), chart, ints(np.int32(-1)))
    return chart_of


def make_look_up(lanes: SimpleNamespace, every: bool) -> Callable[..., Any]:
    """The function that looks up the texture in charts that are known.

    Returns
    -------
    look_up : ``look_up(charts, texels, chart, wanted, x, y, z, channel)``: differences of sRGB
        as lanes, 0 where ``wanted`` (a mask) is false or ``chart`` is -1: of all three channels
        if ``every`` (``channel`` is not looked at), else of the one, a number or lanes of int.

        ``charts`` float32 [C, 12] take lattice coordinates x, y, z to texels (homogeneous, row
        by row), ``texels`` int32 [H, W] hold red, green and blue, signed, in the lowest three
        bytes, 254 to full scale.
    """
    gather, where, floats, ints = lanes.gather, lanes.where, lanes.floats, lanes.ints
    maximum, minimum, bits = lanes.maximum, lanes.minimum, lanes.bits
    lowest, lane_of = lanes.lowest, lanes.lane
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)

    @identified("texel", lanes.width)
    @lanes.jit
    def between(a, b, c, d, fx, fy, left):
        """One channel of four texels, interpolated; ``left`` bits lie above its byte."""
        down = np.int32(24)
        a, b = floats((a << left) >> down), floats((b << left) >> down)
        c, d = floats((c << left) >> down), floats((d << left) >> down)
        top, low = a + fx * (b - a), c + fx * (d - c)
        return (top + fy * (low - top)) * np.float32(1.0 / 254.0)

    @identified("texture look-up", every, lanes.width)
    @lanes.jit
    def look_up(charts, texels, chart, wanted, x, y, z, channel):
        height, width = np.int32(texels.shape[0]), np.int32(texels.shape[1])
        todo = wanted & (chart >= np.int32(0))
        red, green, blue = floats(zero), floats(zero), floats(zero)
        word = bits(todo)
        while word != 0:
            number = lane_of(chart, lowest(word))
            here = todo & (chart == number)
            m = charts[number]
            over = one / (m[8] * x + m[9] * y + m[10] * z + m[11])
            u = (m[0] * x + m[1] * y + m[2] * z + m[3]) * over - half
            v = (m[4] * x + m[5] * y + m[6] * z + m[7]) * over - half
            inside = (here & (u >= zero) & (v >= zero) & (u < np.float32(width - 1))
                      & (v < np.float32(height - 1)))
            i = ints(minimum(maximum(u, zero), np.float32(width - 2)))
            j = ints(minimum(maximum(v, zero), np.float32(height - 2)))
            fx, fy = u - floats(i), v - floats(j)
            first = j * width + i
            a, b = gather(texels, first), gather(texels, first + np.int32(1))
            c, d = gather(texels, first + width), gather(texels, first + (width + np.int32(1)))
            if every:
                red = where(inside, between(a, b, c, d, fx, fy, np.int32(24)), red)
                green = where(inside, between(a, b, c, d, fx, fy, np.int32(16)), green)
                blue = where(inside, between(a, b, c, d, fx, fy, np.int32(8)), blue)
            else:
                left = np.int32(24) - np.int32(8) * channel
                red = where(inside, between(a, b, c, d, fx, fy, left), red)
            todo = todo & ~here
            word = bits(todo)
        return red, green, blue
    return look_up


def make_detail(lanes: SimpleNamespace, every: bool) -> Callable[..., Any]:
    """The function that looks up the texture where a packet's rays end.

    Returns
    -------
    detail : ``detail(table, cells, charts, texels, nx, ny, nz, x, y, z, wanted, channel)``: as
        `make_look_up`'s, by the charts of the places' cells (`make_chart_of`).
    """
    chart_of, look_up = make_chart_of(lanes), make_look_up(lanes, every)

    @identified("detail", every, lanes.width)
    @lanes.jit
    def detail(table, cells, charts, texels, nx, ny, nz, x, y, z, wanted, channel):
        chart = chart_of(table, cells, nx, ny, nz, x, y, z)
        return look_up(charts, texels, chart, wanted, x, y, z, channel)
    return detail


_chart_of, _look_up = make_chart_of(LANES), make_look_up(LANES, True)
_share = make_texture_share(LANES)
_floats, _load, _store = LANES.floats, LANES.load, LANES.store


def add_texture(table, cells, charts, texels, covered, lattice, camera, size, alpha, depth, color):
    """Add the texture to a rendered view, in place.

    Anisotropic filtering: where the surface is turned away, a pixel sees a long piece of it, and
    the mean of several places along that is taken (as in Feline: McCormack et al. 1999), so that
    strokes neither flicker nor blur across it.

    Parameters
    ----------
    table, cells, charts, texels : As for `make_chart_of` and `make_look_up`.
    covered : How long a piece of surface may be, in world units, for one look-up to do.
    lattice, camera, size : As the rendering kernel takes them.
    alpha, depth : float32 [H W], opacity and depth along the optical axis.
    color : float32 [H W 3], with nothing of the background in it yet.
    """
    share_out(_add_lines, size[1], table, cells, charts, texels, covered, lattice, camera, size,
              alpha, depth, color)


@identified("depth slope")
@lean
def _slope(depth, pixel, step, before, after):
    """How the depth changes from pixel to pixel: the smaller way, to either side, or 0 unknown."""
    here = depth[pixel]
    left = right = np.float32(np.nan)
    if before > 0:
        left = (here - depth[pixel - step * before]) / np.float32(before)
    if after > 0:
        right = (depth[pixel + step * after] - here) / np.float32(after)
    # What is not known, or not there, is not smaller.
    if abs(right) < abs(left) or not abs(left) < np.float32(1e30):
        left = right
    return float(left) if abs(left) < np.float32(1e30) else 0.0


@identified("add texture")
@kernel
def _add_lines(since, until, table, cells, charts, texels, covered, lattice, camera, size, alpha,
               depth, color):
    """`add_texture` to some rows."""
    nx, ny, nz = np.int32(lattice[0]), np.int32(lattice[1]), np.int32(lattice[2])
    width, height = size
    # Where rays end, what they let through, the piece of surface that a pixel sees, look-ups there.
    ray = np.zeros((8, 16), np.float32)
    flat = ray.reshape(128)
    for y in range(since, until):
        cy = (y + 0.5 - camera[15]) / camera[13]
        for first in range(0, width, 16):
            many = min(16, width - first)
            some = False
            for pixel in range(y * width + first, y * width + first + many):
                some |= alpha[pixel] > np.float32(0.5)
            if not some:
                continue
            seen, most = 0, 1
            for i in range(16):
                x = first + min(i, many - 1)
                pixel = y * width + x
                away = float(depth[pixel])
                through = np.float32(1.0) - alpha[pixel]
                if i >= many or through >= np.float32(0.5) or not away < 1e30:
                    through, away = np.float32(1.0), 0.0
                cx = (first + i + 0.5 - camera[14]) / camera[12]
                slope_x, slope_y = 0.0, 0.0
                if through < np.float32(0.5):
                    seen += 1
                    # From lattice point to lattice point a surface has ripples.
                    apart = max(1, int(camera[12] / (lattice[3] * away) + 0.5))
                    slope_x = _slope(depth, pixel, 1, min(apart, x), min(apart, width - 1 - x))
                    slope_y = _slope(depth, pixel, width, min(apart, y),
                                     min(apart, height - 1 - y))
                # Along the slope the piece is longer than across it.
                slope = np.sqrt(slope_x * slope_x + slope_y * slope_y)
                across = away / camera[12]
                length = np.sqrt(slope * slope + across * across)
                across, part, probes = max(across, covered), 0.0, 1
                if length > across:
                    # Steps beyond that are an edge of what is seen, not a slope.
                    longer = min(length / across, float(PROBES))
                    part = REACH * np.sqrt(longer * longer - 1.0) * across / (length * slope)
                    probes = int(np.ceil(longer))
                    most = max(most, probes)
                for axis in range(3):
                    right, down = camera[4 * axis], camera[4 * axis + 1]
                    towards = right * cx + down * cy + camera[4 * axis + 2]
                    at = camera[4 * axis + 3] + away * towards
                    along = part * (slope * slope * towards + away * (
                        slope_x * right / camera[12] + slope_y * down / camera[13]))
                    ray[axis, i] = np.float32(at * lattice[3 + axis] + lattice[6 + axis])
                    ray[4 + axis, i] = np.float32(along * lattice[3 + axis])
                ray[3, i], ray[7, i] = through, np.float32(probes)
            if seen == 0:
                continue
            share, count = _share(_load(flat, 48)), _load(flat, 112)
            px, py, pz = _load(flat, 0), _load(flat, 16), _load(flat, 32)
            chart = _chart_of(table, cells, nx, ny, nz, px, py, pz)
            red = green = blue = _floats(np.float32(0.0))
            for probe in range(most):
                place = np.float32(probe + 0.5) / count - np.float32(0.5)
                r, g, b = _look_up(
                    charts, texels, chart, (share > np.float32(0.0)) & (count > np.float32(probe)),
                    px + place * _load(flat, 64), py + place * _load(flat, 80),
                    pz + place * _load(flat, 96), np.int32(0))
                red, green, blue = red + r, green + g, blue + b
            share = share / count
            # Lanes that are not wanted have no detail, whatever their share.
            _store(flat, 0, share * red)
            _store(flat, 16, share * green)
            _store(flat, 32, share * blue)
            for i in range(many):
                pixel = 3 * (y * width + first + i)
                for channel in range(3):
                    color[pixel + channel] = max(color[pixel + channel] + ray[channel, i],
                                                 np.float32(0.0))


@shared("out")
@kernel
def halve(since, until, texels, out):
    """Every second texel of int8 [H, W, 4], blurred, into out int8 [H // 2, W // 2, 4].

    Weights along an axis are 1, 3, 3, 1: with a plain mean of two, strokes as fine as the finer
    texels would come through as false coarse ones. Beyond the border there is no difference: 0.
    """
    height, width = texels.shape[:2]
    for y in range(since, until):
        sums = np.empty((width, 3), np.int64)
        for x in range(width):
            for channel in range(3):
                total = 0
                for k in range(4):
                    row = 2 * y - 1 + k
                    if 0 <= row < height:
                        total += (3 if 0 < k < 3 else 1) * np.int64(texels[row, x, channel])
                sums[x, channel] = total
        for x in range(out.shape[1]):
            for channel in range(3):
                total = 0
                for k in range(4):
                    column = 2 * x - 1 + k
                    if 0 <= column < width:
                        total += (3 if 0 < k < 3 else 1) * sums[column, channel]
                out[y, x, channel] = np.int8((total + 32) >> 6)
