"""A slice of the field: laid out for casting, its directions, and packets of rays sent through it.

For every lattice plane z = k the slice has 13 rows of float16 values along x: density, then four
coefficients of the color's angle for each channel (`plane_matrix`; why four, see `slices`). Values
are interpolated between the two rows of voxels that the plane passes between. Only stretches with
voxels are written.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from ...field.marching import sh_basis
from ...simd.decorators import identified, lean, lean_kernel
from ...simd.interleaved import (
    NEAR,
    largest,
    largest_of_halves,
    look_up_way,
    make_look_up,
    make_near_look_up,
    prefetch,
    smallest,
    smallest_of_halves,
    store_half,
)
from ...simd.vectors import LANES

LINES = 13  # Rows of a plane: density and 3 x 4 coefficients.
AHEAD = 2  # Values before a row's first, always empty.


@identified("slab pitch")
@lean
def pitch_of(nx):
    """Values from one row to the next: `AHEAD`, the row, and room for 64 values from its end on."""
    return nx + 66 + AHEAD


def make_build(count: int) -> Callable[..., Any]:
    """The function that fills a slice, for fields of ``count`` coefficients a channel.

    ``build(places, occupied, values, shape, plane, matrix, threshold, shift, stride, slab, low,
    high, marks)``: the field's `Stretches`, the lattice points along x, y, z and the plane, lattice
    row plane[0] + plane[1] i + plane[2] k at column i of plane k; ``matrix`` as `plane_matrix`
    makes it. It fills every ``stride``-th plane of ``slab`` uint16 [nz * LINES * pitch], the first
    and last filled column ``low`` and ``high`` int64 [nz], and ``marks`` uint64 [nz]: bit b where
    densities over ``threshold`` reach into columns b << shift to (b + 1) << shift.
    """
    floats, ints, iota, where = LANES.floats, LANES.ints, LANES.iota, LANES.where
    bits, lane_of, load_half = LANES.bits, LANES.lane, LANES.load_half
    minimum, maximum = LANES.minimum, LANES.maximum
    lines = 1 + 3 * count
    # A channel's terms that a direction needs: with one coefficient the first, with four no sin 2.
    terms = {1: 1, 4: 3}.get(count, 4)
    one, zero = np.float32(1.0), np.float32(0.0)

    @identified("slab build", count)
    @lean
    def build(places, occupied, values, shape, plane, matrix, threshold, shift, stride, slab, low,
              high, marks):
        nx, ny, nz = shape[0], shape[1], shape[2]
        pitch = pitch_of(nx)
        for k in range(nz - 1, -1, -stride):
            # Forget what the last slice left here.
            base = k * LINES * pitch + AHEAD
            for i in range(low[k], high[k] + 1):
                slab[base + i] = 0
            low[k], high[k], marks[k] = nx, -1, np.uint64(0)
            start_y, step_y = plane[0] + plane[2] * k, plane[1]
            j0 = int(np.floor(min(start_y, start_y + step_y * nx)))
            j1 = int(np.floor(max(start_y, start_y + step_y * nx)))
            if j1 < 0 or j0 > ny - 2:
                continue
            somewhere = np.uint64(0)
            for j in range(max(j0, 0), min(j1 + 2, ny)):
                somewhere |= occupied[j, k]
            for block in range(places.shape[2]):
                if (somewhere >> np.uint64(min(block, 63))) & np.uint64(1) == 0:
                    continue
                x = 16 * block
                y = floats(iota() + np.int32(x)) * np.float32(step_y) + np.float32(start_y)
                fits = (y >= zero) & (y <= np.float32(ny - 1))
                y = maximum(minimum(y, np.float32(ny - 1)), zero)
                row = minimum(ints(y), np.int32(ny - 2))
                part = y - floats(row)
                first, last = lane_of(row, 0), lane_of(row, 15)
                since, until = min(first, last), max(first, last) + 1
                # The slices after this one lie lower: ask for what they will need first.
                below = np.uintp(places[max(since - 1, 0), k, block]) * np.uintp(lines * 16)
                for ahead in range(0, lines * 16, 32):
                    prefetch(values, below + np.uintp(ahead))
                sigma = floats(zero)
                whole = until - since == 1 and bits(fits) == np.uint32(0xFFFF)
                for j in range(since, until):
                    here = fits & (row == np.int32(j))
                    place0 = np.uintp(places[j, k, block]) * np.uintp(lines * 16)
                    place1 = np.uintp(places[j + 1, k, block]) * np.uintp(lines * 16)
                    sigma = (sigma + where(here, one - part, zero) * load_half(values, place0)
                             + where(here, part, zero) * load_half(values, place1))
                store_half(slab, np.uintp(base + x), sigma)
                dense = bits(sigma > threshold)
                for since_bit in range(0, 16, 1 << shift):
                    some = (dense >> np.uint32(since_bit)) & np.uint32((1 << (1 << shift)) - 1)
                    if some != 0:
                        at = x + since_bit
                        marks[k] |= np.uint64(1) << np.uint64(at >> shift)
                        if some & np.uint32(1):  # a ray between columns reads both
                            marks[k] |= np.uint64(1) << np.uint64(max(at - 1, 0) >> shift)
                # What is next to a stretch is empty, unless another one follows.
                for channel in range(3):
                    for term in range(terms):
                        line = base + (1 + 4 * channel + term) * pitch
                        if high[k] < x - 1:
                            slab[line + x - 1] = 0
                        slab[line + x + 16] = 0
                low[k], high[k] = min(low[k], x), x + 15
                for channel in range(3):
                    level, cosine, sine, mixed = floats(zero), floats(zero), floats(zero), floats(
                        zero)
                    for j in range(since, until):
                        share0, share1 = one - part, part
                        if not whole:
                            here = fits & (row == np.int32(j))
                            share0, share1 = where(here, share0, zero), where(here, share1, zero)
                        place0 = np.uintp(places[j, k, block]) * np.uintp(lines * 16)
                        place1 = np.uintp(places[j + 1, k, block]) * np.uintp(lines * 16)
                        for coefficient in range(count):
                            away = np.uintp(16 * (1 + channel * count + coefficient))
                            value = (share0 * load_half(values, place0 + away)
                                     + share1 * load_half(values, place1 + away))
                            at = 16 * coefficient + 4 * channel
                            level = level + matrix[at] * value
                            if terms > 1:
                                cosine = cosine + matrix[at + 1] * value
                                sine = sine + matrix[at + 2] * value
                            if terms > 3:
                                mixed = mixed + matrix[at + 3] * value
                    line = np.uintp(base + (1 + 4 * channel) * pitch + x)
                    store_half(slab, line, level)
                    if terms > 1:
                        store_half(slab, line + np.uintp(pitch), cosine)
                        store_half(slab, line + np.uintp(2 * pitch), sine)
                    if terms > 3:
                        store_half(slab, line + np.uintp(3 * pitch), mixed)
    return build


@identified("plane matrix")
@lean_kernel
def plane_matrix(across, along, count, least, matrix, scratch):
    """Spherical harmonics in the plane of two unit vectors, as coefficients of its angle.

    A direction is ``cos(phi) along + sin(phi) across``, with cosines of ``least`` to 1.
    ``matrix`` float32 [count * 16] is filled: for each coefficient its weights in the four terms of
    a channel, in lanes ``4 * channel + term``, the same for all three channels. ``scratch`` float32
    [5 * 16].
    """
    # The straight line nearest to cos(2 phi) = 2 cos(phi)^2 - 1 over the cosines that occur.
    tilt = np.float32(2.0) * (np.float32(1.0) + least)
    level = -tilt + np.float32(1.0) - np.float32(0.25) * (np.float32(1.0) - least) ** 2
    root = np.float32(np.sqrt(0.5))
    for probe in range(5):
        c = np.float32(1.0 if probe == 0 else (-1.0 if probe == 1 else 0.0))
        s = np.float32(1.0 if probe == 2 else (-1.0 if probe == 3 else 0.0))
        if probe == 4:
            c, s = root, root
        sh_basis(c * along[0] + s * across[0], c * along[1] + s * across[1],
                 c * along[2] + s * across[2], scratch, 16 * probe, count)
    matrix[:] = np.float32(0.0)
    half = np.float32(0.5)
    for part in range(count):
        ahead, back = scratch[part], scratch[16 + part]
        right, left, oblique = scratch[32 + part], scratch[48 + part], scratch[64 + part]
        cosine, sine = half * (ahead - back), half * (right - left)
        constant = np.float32(0.25) * (ahead + back + right + left)
        double = np.float32(0.25) * (ahead + back - right - left)
        mixed = oblique - constant - root * (cosine + sine)
        for channel in range(3):
            place = 16 * part + 4 * channel
            matrix[place] = constant + level * double
            matrix[place + 1] = cosine + tilt * double
            matrix[place + 2], matrix[place + 3] = sine, mixed


@identified("least cosine")
@lean
def least_cosine(nx, nz, side, depth, eyes, aspect, distance):
    """The least cosine in their plane of the rays that meet the lattice.

    ``side`` and ``depth`` give x and z in the display frame of the lattice's point (i, k) as
    (per i, per k, at zero); ``eyes`` float64 [V] are the eyes' x, ``aspect`` half the panel's width
    and ``distance`` its distance from the eyes.
    """
    left, right = aspect, -aspect
    for i in (0, nx - 1):
        for k in (0, nz - 1):
            away = (depth[0] * i + depth[1] * k + depth[2]) / distance
            across = side[0] * i + side[1] * k + side[2]
            for eye in (eyes[0], eyes[-1]):
                px = min(max((across - eye * away) / (1.0 - away), -aspect), aspect)
                left, right = min(left, px), max(right, px)
    most = max(eyes[0], eyes[-1]) - left
    most = max(most, right - min(eyes[0], eyes[-1]))
    return np.float32(distance / np.sqrt(distance * distance + most * most))

GROUP = 8  # Planes that are skipped together where nothing of a packet's way lies in them.


@identified("slice bounded")
@lean
def bounded(x, nx):
    """The column at or before a place, from -1 to nx."""
    return np.int64(np.floor(min(max(x, np.float32(-1.0)), np.float32(nx))))


@identified("slice stripes")
@lean
def stripes(left, right, shift):
    """The marks of columns from ``left`` to ``right`` (see `make_build`)."""
    most = np.uint64(max(right, 0) >> shift)
    return ((np.uint64(2) << most) - np.uint64(1)) & ~(
        (np.uint64(1) << np.uint64(max(left, 0) >> shift)) - np.uint64(1))


def _make_follow(count: int, colors: int, name: str, look_up: Callable[..., Any],
                 near: bool) -> Callable[..., Any]:
    """The function that follows rays through a group of planes; ``count``, ``colors``: `make_cast`.

    Parameters
    ----------
    name : Of the way to look up.
    look_up : ``look_up(array, start, other, index)``, see `make_near_look_up`.
    near : Whether the last eight rays have a stretch of their own, and all rays go together.
    """
    floats, ints, where, bits = LANES.floats, LANES.ints, LANES.where, LANES.bits
    minimum, maximum, fading, iota = LANES.minimum, LANES.maximum, LANES.fading, LANES.iota
    one, half, zero = np.float32(1.0), np.float32(0.5), np.float32(0.0)
    farthest = np.float32(NEAR if near else 62)

    @identified("slice point", name)
    @lean
    def point(slab, place, other, offset, part):
        """A row's values at the rays' places."""
        before, after = look_up(slab, np.uintp(place), np.uintp(other), offset)
        return before + part * (after - before)

    @identified("slice shade", count, name)
    @lean
    def shade(slab, place, other, pitch, offset, part, cosine, sine, mixed):
        """A channel's color, from the rows that begin at a place."""
        color = point(slab, place, other, offset, part)
        if count > 1:
            color = color + cosine * point(slab, place + pitch, other + pitch, offset, part)
            color = color + sine * point(slab, place + 2 * pitch, other + 2 * pitch, offset, part)
        if count > 4:
            color = color + mixed * point(slab, place + 3 * pitch, other + 3 * pitch, offset, part)
        return maximum(color + half, zero)

    @identified("slice follow", count, name, colors)
    @lean
    def follow(slab, marks, way, nx, front, back, stride, low, slant, low_of_last, slant_of_last,
               active, start, slope, delta, cosine, sine, mixed, line, threshold, stop, through,
               first, second, third, end_plane):
        pitch = pitch_of(nx)
        for k in range(front, back - 1, -stride):
            if marks[k] & way == 0:
                continue
            x = minimum(maximum(start + slope * np.float32(k), -one), np.float32(nx))
            base = bounded(low + slant * np.float32(front - k), nx)
            if near:
                other = bounded(low_of_last + slant_of_last * np.float32(front - k), nx)
                x = x - where(iota() < np.int32(8), floats(np.float32(base)),
                              floats(np.float32(other)))
            else:
                other = base
                x = x - np.float32(base)
            x = minimum(maximum(x, zero), farthest)
            offset = ints(x)
            part = x - floats(offset)
            place = k * LINES * pitch + AHEAD
            place, other = place + base, place + other
            sigma = point(slab, place, other, offset, part)
            if near:
                shown = (sigma > threshold) & (through > stop)
            else:
                shown = (sigma > threshold) & active
            if bits(shown) == 0:
                continue
            fade = where(shown, fading(sigma * delta), one)
            place, other = place + line * pitch, other + line * pitch
            weight = through * (one - fade)
            first = first + weight * shade(slab, place, other, pitch, offset, part, cosine, sine,
                                           mixed)
            if colors == 3:
                second = second + weight * shade(slab, place + 4 * pitch, other + 4 * pitch, pitch,
                                                 offset, part, cosine, sine, mixed)
                third = third + weight * shade(slab, place + 8 * pitch, other + 8 * pitch, pitch,
                                               offset, part, cosine, sine, mixed)
            after = through * fade
            crossed = (through >= half) & (after < half)
            if bits(crossed) != 0:
                # A plane stands for what lies half a step before and behind it.
                part = (through - half) / maximum(through - after, np.float32(1e-12)) - half
                end_plane = where(crossed, np.float32(k) - part * np.float32(stride), end_plane)
            through = after
            # Masks that live from plane to plane are packed and unpacked: none where it can be.
            active = active & (through > stop)
            if near:
                if bits(through > stop) == 0:
                    break
            elif bits(active) == 0:
                break
        return through, first, second, third, end_plane
    return follow


def make_cast(count: int, way: str | None, colors: int = 1) -> Callable[..., Any]:
    """The function that sends one packet of rays through a slice.

    ``cast(slab, marks, group_marks, nx, planes, shift, stride, start, slope, delta, cosine, sine,
    line, threshold, stop)``, for ``count`` coefficients a channel; rays lie at column ``start +
    slope k`` of plane k. It follows ``colors`` channels: 1, the one whose first row is ``line``, or
    3. It returns three colors (of one channel, the first), the transmittance, and the plane (a
    fraction) on which half the light is gone. ``way``: see `look_up_way`.
    """
    floats, where, bits = LANES.floats, LANES.where, LANES.bits
    minimum, maximum = LANES.minimum, LANES.maximum
    one, zero = np.float32(1.0), np.float32(0.0)
    way = way or look_up_way()
    nears = way == "near"
    look_up = make_look_up(way)

    @identified("slice look up", way)
    @lean
    def one_stretch(slab, place, _other, offset):
        return look_up(slab, place, offset)

    follow = _make_follow(count, colors, way, one_stretch, False)
    follow_near = follow
    if nears:
        follow_near = _make_follow(count, colors, "apart", make_near_look_up(), True)

    @identified("slice cast", count, way, colors)
    @lean
    def cast(slab, marks, group_marks, nx, planes, shift, stride, start, slope, delta, cosine, sine,
             line, threshold, stop):
        first, second, third = floats(zero), floats(zero), floats(zero)
        through, end_plane = floats(one), floats(zero)
        alive = through > zero
        mixed = np.float32(2.0) * sine * cosine
        # Light fades by half where it faded to 1 / e.
        delta = delta * np.float32(1.4426950408889634)
        low = high = low_slope = high_slope = zero
        begin, crosses = 0, False
        for group in range(len(group_marks)):
            front = planes - 1 - group * GROUP * stride
            back = max(front - (GROUP - 1) * stride, 0)
            # Bounds of the packet's way, found once for eight groups: between two planes the
            # outermost rays lie within the straight lines between their places there.
            if group % 8 == 0:
                begin, end = front, max(front - 8 * GROUP * stride, 0)
                at_begin = start + slope * np.float32(begin)
                at_end = start + slope * np.float32(end)
                low, low_end = smallest(at_begin), smallest(at_end)
                high, high_end = largest(at_begin), largest(at_end)
                run = np.float32(1.0) / np.float32(max(begin - end, 1))
                low_slope, high_slope = (low_end - low) * run, (high_end - high) * run
                marked = np.uint64(0)
                for other in range(group, min(group + 8, len(group_marks))):
                    marked |= group_marks[other]
                crosses = marked & stripes(bounded(min(low, low_end), nx),
                                           bounded(max(high, high_end), nx), shift) != 0
            if not crosses:
                continue
            ahead, behind = np.float32(begin - front), np.float32(begin - back)
            base = bounded(min(low + low_slope * ahead, low + low_slope * behind), nx)
            most = max(high + high_slope * ahead, high + high_slope * behind)
            way = stripes(base, bounded(most, nx), shift)
            if group_marks[group] & way == 0:
                continue
            if nears:
                at_front = start + slope * np.float32(front)
                at_back = start + slope * np.float32(back)
                left, left_of_last = smallest_of_halves(at_front)
                right, right_of_last = largest_of_halves(at_front)
                left_end, left_end_of_last = smallest_of_halves(at_back)
                right_end, right_end_of_last = largest_of_halves(at_back)
                if max(max(right - left, right_end - left_end),
                       max(right_of_last - left_of_last,
                           right_end_of_last - left_end_of_last)) < np.float32(NEAR - 1):
                    run = np.float32(1.0) / np.float32(max(front - back, 1))
                    through, first, second, third, end_plane = follow_near(
                        slab, marks, way, nx, front, back, stride, left, (left_end - left) * run,
                        left_of_last, (left_end_of_last - left_of_last) * run, alive, start, slope,
                        delta, cosine, sine, mixed, line, threshold, stop, through, first, second,
                        third, end_plane)
                    alive = through > stop
                    if bits(alive) == 0:
                        break
                    continue
            todo = alive
            whole = min(most, np.float32(nx)) < np.float32(base + 62)
            while bits(todo) != 0:
                active = todo
                if not whole:
                    # Those rays that stay within 63 columns from the leftmost one's on go together.
                    at_front = start + slope * np.float32(front)
                    at_back = start + slope * np.float32(back)
                    near, far = minimum(at_front, at_back), maximum(at_front, at_back)
                    far = minimum(far, np.float32(nx))
                    base = bounded(smallest(where(todo, near, np.float32(nx))), nx)
                    active = todo & (far < np.float32(base + 62))
                    most = largest(where(active, far, -one))
                    way = stripes(base, bounded(most, nx), shift)
                todo = todo & ~active
                through, first, second, third, end_plane = follow(
                    slab, marks, way, nx, front, back, stride, np.float32(base), zero,
                    np.float32(base), zero, active, start, slope, delta, cosine, sine, mixed, line,
                    threshold, stop, through, first, second, third, end_plane)
            alive = through > stop
            if bits(alive) == 0:
                break
        # Behind the stop lies more of the same surface: its color is taken to go on.
        ended = through <= stop
        whole_of = where(ended, one / (one - through), one)
        return (first * whole_of, second * whole_of, third * whole_of,
                where(ended, zero, through), end_plane)

    return cast
