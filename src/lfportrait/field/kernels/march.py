"""Casting packets of rays through bricks: one loop, written once over a lane namespace.

A packet is 16 rays. Positions are in lattice units: lattice
point i lies at coordinate i. A ray's samples lie on the comb t = start + k step, whatever space is
skipped, so that skipping changes no result. At each sample the density is interpolated trilinearly
in lanes, 16 rays at once; color is evaluated ray by ray with the coefficients in lanes, by the
``shade`` function that the factory is given.

To build a kernel on it: ``march = make_march(LANES, shade)`` where ``shade(links, rows, base,
weights, lane, basis, channel)`` returns the sample's (r, g, b) for one lane as float32 numbers.
`make_rgb_shade` evaluates all three channels, `make_channel_shade` only the one that a sub-pixel
shows (it returns it three times; use the first). `basis` is a per-thread float32 scratch of
[lanes * 64] that `make_basis` fills for each ray's direction. ``march`` returns
(r, g, b, transmittance, depth) as lanes, without the background: add transmittance * background.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...arrays import Float64, Floats
from ...simd.decorators import identified, identity, lean, lean_kernel
from ...simd.vectors import LANES

C0 = 0.28209479177387814
"""1 / (2 sqrt(pi))."""


def real_harmonics(directions: Floats, count: int) -> Float64:
    """The first ``count`` (1, 4 or 9) real harmonics of unit directions [N, 3], [N, count].

    The NumPy twin of `lfportrait.field.kernels.march.sh_basis`.
    """
    x, y, z = np.asarray(directions, np.float64).T
    first, second = 0.4886025119029199, 1.0925484305920792
    planes = [np.full(len(x), C0), -first * y, first * z, -first * x, second * x * y,
              -second * y * z, 0.31539156525252005 * (2 * z * z - x * x - y * y),
              -second * x * z, 0.5 * second * (x * x - y * y)]
    return np.stack(planes[:count], axis=1)


@identified("sh_basis")
@lean_kernel
def sh_basis(x, y, z, out, start, count):
    """Real spherical harmonics of a unit direction, in svox2's order, into out[start:start+count].

    The direction is the ray's, in the world.
    """
    out[start] = np.float32(0.28209479177387814)
    if count > 1:
        out[start + 1] = np.float32(-0.4886025119029199) * y
        out[start + 2] = np.float32(0.4886025119029199) * z
        out[start + 3] = np.float32(-0.4886025119029199) * x
    if count > 4:
        out[start + 4] = np.float32(1.0925484305920792) * x * y
        out[start + 5] = np.float32(-1.0925484305920792) * y * z
        out[start + 6] = np.float32(0.31539156525252005) * (
            np.float32(2.0) * z * z - x * x - y * y)
        out[start + 7] = np.float32(-1.0925484305920792) * x * z
        out[start + 8] = np.float32(0.5462742152960396) * (x * x - y * y)


def make_basis(width: int) -> Callable[..., Any]:
    """A function that lays a ray's basis out as the vectors a color row is multiplied with.

    Vectors per lane: the first 16 coefficients' share of red, of green; the rest's share of green,
    of blue. A row of 16 has no rest: its blue lies in the third vector.
    """
    two = width == 32

    @identified("fill", width)
    @lean
    def fill(x, y, z, count, basis, start, scratch):
        for i in range(64):
            basis[start + i] = np.float32(0.0)
        sh_basis(x, y, z, scratch, 0, count)
        for i in range(count):
            value = scratch[i]
            basis[start + i] = value
            if two:
                green, blue = count + i, 2 * count + i - 16
                if green < 16:
                    basis[start + 16 + green] = value
                else:
                    basis[start + 32 + green - 16] = value
                basis[start + 48 + blue] = value
            else:
                basis[start + 16 + count + i] = value
                basis[start + 32 + 2 * count + i] = value
    return fill


def make_rgb_shade(width: int, lanes: SimpleNamespace = LANES) -> Callable[..., Any]:
    """Color of one sample: eight rows interpolated, dotted with the ray's basis, + 0.5, >= 0."""
    load_half, total, load = lanes.load_half, lanes.total, lanes.load
    floats = lanes.floats
    two = width == 32

    @identified("rgb shade", width, lanes.width)
    @lean
    def shade(links, rows, base, weights, lane, basis, channel):
        first = floats(np.float32(0.0))
        rest = floats(np.float32(0.0))
        for corner in range(8):
            offset = (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1)
            row = np.uintp(links[np.uintp(base + offset)]) * np.uintp(width)
            first += weights[corner] * load_half(rows, row)
            if two:
                rest += weights[corner] * load_half(rows, row + np.uintp(16))
        start = np.uintp(lane * 64)
        red = total(first * load(basis, start))
        if two:
            green = total(first * load(basis, start + np.uintp(16))
                          + rest * load(basis, start + np.uintp(32)))
            blue = total(rest * load(basis, start + np.uintp(48)))
        else:
            green = total(first * load(basis, start + np.uintp(16)))
            blue = total(first * load(basis, start + np.uintp(32)))
        half, zero = np.float32(0.5), np.float32(0.0)
        return max(red + half, zero), max(green + half, zero), max(blue + half, zero)
    return shade


def make_channel_shade(width: int, basis_count: int,
                       lanes: SimpleNamespace = LANES) -> Callable[..., Any]:
    """One channel of one sample, for a sub-pixel: a window of 16 coefficients of each row."""
    load_half, total, load, floats = lanes.load_half, lanes.total, lanes.load, lanes.floats

    @identified("channel shade", width, basis_count, lanes.width)
    @lean
    def shade(links, rows, base, weights, lane, basis, channel):
        window = np.uintp(channel * basis_count)
        first = floats(np.float32(0.0))
        for corner in range(8):
            offset = (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1)
            row = np.uintp(links[np.uintp(base + offset)]) * np.uintp(width)
            first += weights[corner] * load_half(rows, row + window)
        # The basis' first vector is zero beyond the channel's own coefficients.
        value = total(first * load(basis, np.uintp(lane * 64)))
        value = max(value + np.float32(0.5), np.float32(0.0))
        return value, value, value
    return shade


@identified("enter_box")
@lean
def enter_box(ox, oy, oz, dx, dy, dz, nx, ny, nz):
    """Where a ray enters and leaves the lattice [0, n - 1]^3, as (start, end); start > end: never.

    Entry is not behind the origin.
    """
    start, end = np.float32(0.0), np.float32(1e30)
    for axis in range(3):
        o = ox if axis == 0 else (oy if axis == 1 else oz)
        d = dx if axis == 0 else (dy if axis == 1 else dz)
        n = np.float32((nx if axis == 0 else (ny if axis == 1 else nz)) - 1)
        if abs(d) < np.float32(1e-9):
            if o < np.float32(0.0) or o > n:
                end = np.float32(-1.0)
        else:
            a, b = -o / d, (n - o) / d
            start = max(start, min(a, b))
            end = min(end, max(a, b))
    return start, end


def make_locate(lanes: SimpleNamespace) -> Callable[..., Any]:
    """A function that finds the cells of positions: bricks, offsets inside, fractions."""
    ints, floats = lanes.ints, lanes.floats
    minimum, maximum, gather = lanes.minimum, lanes.maximum, lanes.gather3

    @identified("locate", lanes.width)
    @lanes.jit
    def locate(table, px, py, pz, nx, ny, nz):
        zero = np.float32(0.0)
        ix = minimum(ints(maximum(px, zero)), np.int32(nx - 2))
        iy = minimum(ints(maximum(py, zero)), np.int32(ny - 2))
        iz = minimum(ints(maximum(pz, zero)), np.int32(nz - 2))
        two, three = np.int32(2), np.int32(3)
        bx, by, bz = ix >> two, iy >> two, iz >> two
        brick = gather(table, (bz * np.int32(table.shape[1]) + by) * np.int32(table.shape[2]) + bx)
        inner = ((iz & three) * np.int32(25) + (iy & three) * np.int32(5) + (ix & three))
        return (brick, bx, by, bz, inner, px - floats(ix), py - floats(iy), pz - floats(iz))
    return locate


def make_march(lanes: SimpleNamespace, shade: Callable[..., Any], shaded: bool = True,
               ) -> Callable[..., Any]:
    """The marching loop over one packet; unless ``shaded``, for opacity and depth alone.

    Returns
    -------
    march : ``march(table, links, density, rows, nx, ny, nz, ox, oy, oz, dx, dy, dz, start, end,
        step, delta, threshold, stop, basis, channel)``: origins and unit directions in lattice
        units, comb start and end of each ray, ``step`` in lattice units, ``delta`` [lanes] the
        step in world units (Shen et al. 2023, Eq. 1), density threshold, transmittance to stop
        at.
    """
    floats, where, floor = lanes.floats, lanes.where, lanes.floor
    minimum, maximum, exp = lanes.minimum, lanes.maximum, lanes.exp
    gather_pair, bits, lowest = lanes.gather_pair, lanes.bits, lanes.lowest
    lane_of, iota = lanes.lane, lanes.iota
    locate = make_locate(lanes)
    one, zero, half = np.float32(1.0), np.float32(0.0), np.float32(0.5)

    @identified("march", lanes.width, identity(shade), shaded)
    @lanes.jit
    def march(table, links, density, rows, nx, ny, nz, ox, oy, oz, dx, dy, dz, start, end, step,
              delta, threshold, stop, basis, channel):
        red, green, blue = floats(zero), floats(zero), floats(zero)
        through = floats(one)
        depth = floats(np.float32(np.inf))
        k = floats(zero)
        tiny = np.float32(1e-9)
        inverse_x = one / where((dx < tiny) & (dx > -tiny), tiny, dx)
        inverse_y = one / where((dy < tiny) & (dy > -tiny), tiny, dy)
        inverse_z = one / where((dz < tiny) & (dz > -tiny), tiny, dz)
        inverse_step = one / step
        t = start
        alive = start < end
        while bits(alive) != 0:
            px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
            brick, bx, by, bz, inner, fx, fy, fz = locate(table, px, py, pz, nx, ny, nz)
            vacant = brick < np.int32(0)
            advance = floats(one)
            if bits(alive & ~vacant) != 0:
                base = maximum(brick, np.int32(0)) * np.int32(128) + inner
                d000, d001 = gather_pair(density, base)
                d010, d011 = gather_pair(density, base + np.int32(5))
                d100, d101 = gather_pair(density, base + np.int32(25))
                d110, d111 = gather_pair(density, base + np.int32(30))
                d00, d01 = d000 + fx * (d001 - d000), d010 + fx * (d011 - d010)
                d10, d11 = d100 + fx * (d101 - d100), d110 + fx * (d111 - d110)
                d0, d1 = d00 + fy * (d01 - d00), d10 + fy * (d11 - d10)
                sigma = d0 + fz * (d1 - d0)
                shown = alive & ~vacant & (sigma > threshold)
                word = bits(shown)
                if word != 0:
                    fade = where(shown, exp(-(sigma * delta)), one)
                    weight = through * (one - fade)
                    r, g, b = floats(zero), floats(zero), floats(zero)
                    while shaded and word != 0:
                        lane = lowest(word)
                        word &= word - np.uint32(1)
                        x, y, z = lane_of(fx, lane), lane_of(fy, lane), lane_of(fz, lane)
                        weights = ((one - z) * (one - y) * (one - x), (one - z) * (one - y) * x,
                                   (one - z) * y * (one - x), (one - z) * y * x,
                                   z * (one - y) * (one - x), z * (one - y) * x,
                                   z * y * (one - x), z * y * x)
                        cr, cg, cb = shade(links, rows, lane_of(base, lane), weights, lane, basis,
                                           lane_of(channel, lane))
                        here = iota() == np.int32(lane)
                        r, g, b = where(here, cr, r), where(here, cg, g), where(here, cb, b)
                    red, green, blue = red + weight * r, green + weight * g, blue + weight * b
                    after = through * fade
                    crossed = shown & (through >= half) & (after < half)
                    if bits(crossed) != 0:
                        # Inside the step the transmittance falls exponentially; to first order
                        # the half is reached in proportion.
                        part = (through - half) / maximum(through - after, np.float32(1e-12))
                        depth = where(crossed, t + (part - half) * step, depth)
                    through = after
            if bits(alive & vacant) != 0:
                reach = floats(-brick - np.int32(1)) * np.float32(4.0)
                cx = floats(bx << np.int32(2)) - reach
                cy = floats(by << np.int32(2)) - reach
                cz = floats(bz << np.int32(2)) - reach
                span = reach + reach + np.float32(4.0)
                leave = (where(dx > zero, cx + span, cx) - px) * inverse_x
                leave = minimum(leave, (where(dy > zero, cy + span, cy) - py) * inverse_y)
                leave = minimum(leave, (where(dz > zero, cz + span, cz) - pz) * inverse_z)
                far = floor(maximum(leave, zero) * inverse_step) + one
                advance = where(vacant, minimum(far, np.float32(1e6)), advance)
            k = k + advance
            t = start + k * step
            alive = alive & (t < end) & (through > stop)
        return red, green, blue, through, depth
    return march


def lattice_of_world(center: Any, radius: Any, shape: tuple[int, int, int],
                     ) -> tuple[np.ndarray, np.ndarray]:
    """Scale and offset [3] (x, y, z) with lattice coordinate = world * scale + offset."""
    size = np.array(shape[::-1], np.float64)
    scale = size / (2.0 * np.asarray(radius, np.float64))
    return scale, size / 2.0 - 0.5 - np.asarray(center, np.float64) * scale
