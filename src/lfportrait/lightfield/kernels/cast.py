"""Sending packets of rays through a slice of the field, from plane to plane (see `slices`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...lanes.cache_keys import identified
from ...lanes.decorators import lean
from ...lanes.shuffles import largest, make_look_up, smallest
from ...lanes.vectors import LANES
from .slab import AHEAD, LINES, pitch_of

__all__ = ["GROUP", "make_cast"]

GROUP = 8
"""Planes that are skipped together where nothing of a packet's way lies in them."""


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


def make_cast(count: int, permutes: bool | None, colors: int = 1) -> Callable[..., Any]:
    """The function that sends one packet of rays through a slice.

    Parameters
    ----------
    count
        Coefficients a channel of the field's colors.
    permutes
        See `make_look_up`.
    colors
        Channels that it follows: 1, the one whose first row is ``line``, or 3.

    Returns
    -------
    cast
        ``cast(slab, marks, group_marks, nx, planes, shift, stride, start, slope, delta, cosine,
        sine, line, threshold, stop)``; rays lie at column ``start + slope k`` of plane k. It
        returns three colors (of one channel, the first), the transmittance, and the plane (a
        fraction) on which half the light is gone.
    """
    floats, ints, where, exp, bits = LANES.floats, LANES.ints, LANES.where, LANES.exp, LANES.bits
    minimum, maximum = LANES.minimum, LANES.maximum
    look_up = make_look_up(permutes)
    one, half, zero = np.float32(1.0), np.float32(0.5), np.float32(0.0)

    @identified("slice point", permutes)
    @lean
    def point(slab, place, offset, part):
        """A row's values at the rays' places."""
        before, after = look_up(slab, np.uintp(place), offset)
        return before + part * (after - before)

    @identified("slice shade", count, permutes)
    @lean
    def shade(slab, place, pitch, offset, part, cosine, sine, mixed):
        """A channel's color, from the rows that begin at a place."""
        color = point(slab, place, offset, part)
        if count > 1:
            color = color + cosine * point(slab, place + pitch, offset, part)
            color = color + sine * point(slab, place + 2 * pitch, offset, part)
        if count > 4:
            color = color + mixed * point(slab, place + 3 * pitch, offset, part)
        return maximum(color + half, zero)

    @identified("slice cast", count, permutes, colors)
    @lean
    def cast(slab, marks, group_marks, nx, planes, shift, stride, start, slope, delta, cosine, sine,
             line, threshold, stop):
        pitch = pitch_of(nx)
        first, second, third = floats(zero), floats(zero), floats(zero)
        through, end_plane = floats(one), floats(zero)
        alive = through > zero
        mixed = np.float32(2.0) * sine * cosine
        low = high = low_slope = high_slope = zero
        begin = 0
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
            ahead, behind = np.float32(begin - front), np.float32(begin - back)
            base = bounded(min(low + low_slope * ahead, low + low_slope * behind), nx)
            most = max(high + high_slope * ahead, high + high_slope * behind)
            todo = alive
            whole = min(most, np.float32(nx)) < np.float32(base + 62)
            if group_marks[group] & stripes(base, bounded(most, nx), shift) == 0:
                continue
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
                todo = todo & ~active
                way = stripes(base, bounded(most, nx), shift)
                for k in range(front, back - 1, -stride):
                    if marks[k] & way == 0:
                        continue
                    x = minimum(maximum(start + slope * np.float32(k), -one), np.float32(nx))
                    x = minimum(maximum(x - np.float32(base), zero), np.float32(62.0))
                    offset = ints(x)
                    part = x - floats(offset)
                    place = k * LINES * pitch + AHEAD + base
                    sigma = point(slab, place, offset, part)
                    shown = active & (sigma > threshold)
                    if bits(shown) == 0:
                        continue
                    fade = where(shown, exp(-(sigma * delta)), one)
                    place += line * pitch
                    weight = through * (one - fade)
                    first = first + weight * shade(slab, place, pitch, offset, part, cosine, sine,
                                                   mixed)
                    if colors == 3:
                        second = second + weight * shade(slab, place + 4 * pitch, pitch, offset,
                                                         part, cosine, sine, mixed)
                        third = third + weight * shade(slab, place + 8 * pitch, pitch, offset,
                                                       part, cosine, sine, mixed)
                    after = through * fade
                    crossed = shown & (through >= half) & (after < half)
                    if bits(crossed) != 0:
                        # A plane stands for what lies half a step before and behind it.
                        part = (through - half) / maximum(through - after, np.float32(1e-12)) - half
                        end_plane = where(crossed, np.float32(k) - part * np.float32(stride),
                                          end_plane)
                    through = after
                    active = active & (through > stop)
                    if bits(active) == 0:
                        break
            alive = through > stop
            if bits(alive) == 0:
                break
        # Behind the stop lies more of the same surface: its color is taken to go on.
        ended = through <= stop
        whole_of = where(ended, one / (one - through), one)
        return (first * whole_of, second * whole_of, third * whole_of,
                where(ended, zero, through), end_plane)

    return cast
