"""Coding a panel and rendering level cameras row by row: all rays of a row lie in one plane.

The plane through the eyes' line and a row of the panel holds every ray of the row's sub-pixels,
whatever their views. So a row needs one slice of the field: density and color where the plane cuts
the lattice planes z = k, interpolated between two rows of voxels. In the slice a ray is a straight
line x(k), and a sample on each lattice plane takes two values instead of eight.

A direction in the plane is one angle, phi, from the panel's normal, so that spherical harmonics of
degree 2, nine coefficients a channel, are a trigonometric polynomial with five: 1, cos phi, sin
phi, sin 2 phi, cos 2 phi. Over a view cone cos 2 phi is next to straight in cos phi (to 0.1 %
within 20 degrees, to 0.5 % within 30), so four are kept for each point of the slice.

Sixteen rays of one channel go through the planes together, front to back: within a few lenses the
sub-pixels are ordered by their view, so that a packet's rays stay close, and on each plane read
from one short stretch of each row, which fits two registers.

A camera that is neither rolled nor raised sees, along a row, a plane through its own right axis,
which it shares with all cameras beside it that look the same way, as those of a quilt do: one slice
serves them all. There a packet is 16 pixels of a row, and follows all three channels.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ...field.marching import make_detail, make_texture_share
from ...simd.decorators import identified, kernel, lean
from ...simd.threads import shared
from ...simd.vectors import LANES
from .panel import eye_of, side_of
from .slab import GROUP, LINES, least_cosine, make_build, make_cast, pitch_of, plane_matrix

_WINDOW = 768  # Most neighbouring sub-pixels that are ordered by view.


@functools.cache
def slice_kernel(count: int, way: str | None = None) -> Callable[..., Any]:
    """The kernel for colors of ``count`` coefficients a channel.

    ``encode(places, occupied, values, table, cells, charts, texels, lattice, matrix, axes, mask,
    fixed, eyes, panel, stride, threshold, stop, background, workers, out)``: as `encode_kernel` has
    it, but the field's values come as `Stretches`, ``matrix`` float64 [3, 4] takes the display
    frame to lattice coordinates (only its second row may depend on y, and that on nothing else),
    ``axes`` float64 [2, 3] the display's x and z axes in the field's world, ``stride`` is the
    number of lattice planes to a sample and ``workers`` the number of threads. Where ``background``
    is below 0, ``out`` holds what is behind the field.
    """
    build, cast = make_build(count), make_cast(count, way)
    load, store, floats = LANES.load, LANES.store, LANES.floats
    sqrt, bits, minimum, maximum = LANES.sqrt, LANES.bits, LANES.minimum, LANES.maximum
    look_up, texture_share = make_detail(LANES, False), make_texture_share(LANES)

    @identified("slice order", count)
    @lean
    def _order(mask, begin, end, fixed, eyes, y, panel, tally, place_at, eye_at, x_at):
        """Every third sub-pixel of a window in the order of their views; returns their number."""
        across = len(mask)
        many = (end - begin + 2) // 3
        continuous = panel[6] > 0.5 and fixed < 0
        # Two neighbouring pixels may have their sub-pixels elsewhere; all others are as these.
        scale, column = 2.0 * panel[0] / across, begin // 3 % 2
        even = side_of(begin, y, across, panel) - scale * begin
        odd = even + scale * (panel[37 + 6 * (y % 4) + 3 * (1 - column) + begin % 3]
                              - panel[37 + 6 * (y % 4) + 3 * column + begin % 3])
        tally[:] = 0
        if fixed < 0:
            for place in range(begin, end, 3):
                tally[np.uintp(mask[place]) + np.uintp(1)] += 1
            for view in range(1, len(tally)):
                tally[view] += tally[view - 1]
        for number in range(many):
            place = begin + 3 * number
            view = np.uintp(fixed if fixed >= 0 else mask[place])
            entry = np.uintp(tally[view])
            tally[view] += 1
            place_at[entry] = place
            x_at[entry] = np.float32(scale * place + (odd if number & 1 else even))
            eye_at[entry] = np.float32(eye_of(place, y, eyes, panel) if continuous else eyes[view])
        for entry in range(many, (many + 15) // 16 * 16):
            eye_at[entry], x_at[entry] = eye_at[many - 1], x_at[many - 1]
        return many

    @shared("workers")
    @identified("slice encode", count, way)
    @kernel
    def encode(since, until, places, occupied, values, table, cells, charts, texels, lattice,
               matrix, axes, mask, fixed, eyes, panel, stride, threshold, stop, background,
               workers, out):
        height, across = mask.shape
        nx, ny, nz = np.int64(lattice[0]), np.int64(lattice[1]), np.int64(lattice[2])
        aspect, eye_y, distance, size = panel[0], panel[1], panel[2], panel[3]
        bgr, textured = panel[8] > 0.5, len(cells) > 0
        pitch = pitch_of(nx)
        shift = 0
        while (nx >> shift) > 63:
            shift += 1
        views = len(eyes)
        # Rays of a packet are apart by their places within a window and by their directions, a
        # share of the cone that falls with the window's size: as much by one as by the other, a
        # quarter of the lattice away from the panel.
        spread = abs(eyes[views - 1] - eyes[0]) / distance * nz / 4.0
        apart = 2.0 * aspect * abs(matrix[0, 0]) / across
        wanted = np.sqrt(48.0 * spread / apart) if fixed < 0 else 48.0
        window = 48 * min(max(int(wanted / 48.0 + 0.5), 1), _WINDOW // 48)
        # Depth and x in the display frame of a point of the slice (i, k).
        det = matrix[0, 0] * matrix[2, 2] - matrix[0, 2] * matrix[2, 0]
        depth_i, depth_k = -matrix[2, 0] / det, matrix[0, 0] / det
        depth_0 = -depth_i * matrix[0, 3] - depth_k * matrix[2, 3]
        side_i, side_k = matrix[2, 2] / det, -matrix[0, 2] / det
        side_0 = -side_i * matrix[0, 3] - side_k * matrix[2, 3]
        shape = np.array([nx, ny, nz])
        least = least_cosine(nx, nz, (side_i, side_k, side_0), (depth_i, depth_k, depth_0), eyes,
                              aspect, distance)
        groups = (nz + GROUP * stride - 1) // (GROUP * stride)
        nearer = 1.0 / distance
        backed = background < np.float32(0.0)
        blank = np.uint8(min(max(background, np.float32(0.0)), np.float32(1.0))
                         * np.float32(255.0) + np.float32(0.5))
        for worker in range(since, until):
            slab = np.zeros(nz * LINES * pitch, np.uint16)
            low, high = np.full(nz, nx), np.full(nz, -1)
            marks, group_marks = np.zeros(nz, np.uint64), np.zeros(groups, np.uint64)
            basis, scratch = np.zeros(count * 16, np.float32), np.zeros(80, np.float32)
            plane, along = np.zeros(3), np.zeros(3, np.float32)
            side = axes[0].astype(np.float32)
            eye_at, x_at = np.zeros(_WINDOW, np.float32), np.zeros(_WINDOW, np.float32)
            place_at, lane = np.zeros(_WINDOW, np.int64), np.zeros(16, np.float32)
            tally = np.zeros(views + 1, np.int64)
            for y in range(worker, height, workers):
                row = out[y]
                if not backed:
                    row[:] = blank
                line = int(panel[4]) + y * int(panel[7])
                py = 1.0 - 2.0 * (line + 0.5) / panel[5]
                rise = eye_y - py
                # The plane cuts (i, k) at lattice row plane[0] + plane[1] i + plane[2] k.
                lift = matrix[1, 1] * rise / distance
                plane[0] = matrix[1, 1] * py + matrix[1, 3] + lift * depth_0
                plane[1], plane[2] = lift * depth_i, lift * depth_k
                norm = np.sqrt(rise * rise + distance * distance)
                for axis in range(3):
                    up = 1.0 if axis == 1 else 0.0
                    along[axis] = np.float32((-rise * up - distance * axes[1, axis]) / norm)
                plane_matrix(side, along, count, least, basis, scratch)
                build(places, occupied, values, shape, plane, basis, np.float32(threshold), shift,
                      stride, slab, low, high, marks)
                # Where the panel shows any of it: between the outermost rays of all eyes.
                left, right = 1e9, -1e9
                for group in range(groups):
                    group_marks[group] = 0
                    front = nz - 1 - group * GROUP * stride
                    for k in range(front, max(front - GROUP * stride, -1), -stride):
                        if low[k] > high[k]:
                            continue
                        group_marks[group] |= marks[k]
                        for end in (low[k] - 1, high[k] + 1):
                            depth = (depth_i * end + depth_k * k + depth_0) * nearer
                            there, per = side_i * end + side_k * k + side_0, 1.0 / (1.0 - depth)
                            for eye in (eyes[0], eyes[views - 1]):
                                px = (there - eye * depth) * per
                                left, right = min(left, px), max(right, px)
                if left > right:
                    continue
                # A sub-pixel may lie a little beside its place.
                first = max(0, int(np.floor((left / aspect + 1.0) * across / 2.0)) - 3)
                last = min(across, int(np.ceil((right / aspect + 1.0) * across / 2.0)) + 4)
                for turn in range(first // 3 * 3, last, window):
                    for third in range(3):
                        many = _order(mask[y], turn + third, min(turn + window, last), fixed, eyes,
                                      line, panel, tally, place_at, eye_at, x_at)
                        channel = 2 - third if bgr else third
                        for entry in range(0, many, 16):
                            px, ex = load(x_at, np.uintp(entry)), load(eye_at, np.uintp(entry))
                            sideways = ex - px
                            length = sqrt(sideways * sideways + np.float32(norm * norm))
                            deep = (np.float32(matrix[2, 0]) * sideways
                                    + np.float32(matrix[2, 2] * distance))
                            slope = (np.float32(matrix[0, 0]) * sideways
                                     + np.float32(matrix[0, 2] * distance)) / deep
                            at_panel = np.float32(matrix[2, 0]) * px + np.float32(matrix[2, 3])
                            start = (np.float32(matrix[0, 0]) * px + np.float32(matrix[0, 3])
                                     - slope * at_panel)
                            delta = length * np.float32(stride / size) / deep
                            value, _, _, through, depth_plane = cast(
                                slab, marks, group_marks, nx, nz, shift, stride, start, slope,
                                delta, np.float32(norm) / length,
                                floats(np.float32(0.0)) - sideways / length, 1 + 4 * channel,
                                np.float32(threshold), np.float32(stop))
                            if bits(through < np.float32(1.0)) == 0:
                                continue  # nothing but what is behind
                            share = texture_share(through)
                            wanted = share > np.float32(0.0)
                            if textured and bits(wanted) != 0:
                                x = start + slope * depth_plane
                                detail, _, _ = look_up(
                                    table, cells, charts, texels, np.int32(nx), np.int32(ny),
                                    np.int32(nz), x, np.float32(plane[0]) + np.float32(plane[1])
                                    * x + np.float32(plane[2]) * depth_plane, depth_plane, wanted,
                                    np.int32(channel))
                                value = value + share * detail
                            used = min(16, many - entry)
                            behind = floats(background)
                            if backed:
                                for i in range(used):
                                    lane[i] = row[place_at[entry + i]]
                                behind = load(lane, np.uintp(0)) * np.float32(1.0 / 255.0)
                            shown = minimum(maximum(value + through * behind, np.float32(0.0)),
                                            np.float32(1.0))
                            store(lane, np.uintp(0), shown * np.float32(255.0) + np.float32(0.5))
                            for i in range(used):
                                row[place_at[entry + i]] = np.uint8(lane[i])

    return encode


@identified("view columns")
@lean
def _columns(camera, lattice, low, high, back, front, width):
    """First pixel, and first beyond, that may show columns low to high of planes back to front."""
    left, right = 1e9, -1e9
    for corner in range(4):
        i, k = (low if corner & 1 else high), (back if corner & 2 else front)
        x = (i - lattice[6]) / lattice[3] - camera[3]
        z = (k - lattice[8]) / lattice[5] - camera[11]
        ahead = camera[2] * x + camera[10] * z
        place = camera[12] * (camera[0] * x + camera[8] * z) / ahead + camera[14]
        left, right = min(left, place), max(right, place)
    return max(0, int(np.floor(left)) - 1), min(width, int(np.ceil(right)) + 1)


@functools.cache
def view_kernel(count: int, way: str | None = None) -> Callable[..., Any]:
    """The kernel for colors of ``count`` coefficients a channel.

    ``render(places, occupied, values, lattice, cameras, least, stride, threshold, stop, workers,
    color, alpha, depth)``: the field's `Stretches`; ``cameras`` float64 [V, 16], pose row by row,
    focal x, y, principal point x, y, of cameras that differ only by what lies along their right
    axis: eye, focal x and principal x. That axis is level, and the lattice lies before all of them,
    so that rays go from its last plane to its first. ``least`` is the least cosine, in a row's
    plane, between a ray and the middle; ``stride``, ``threshold``, ``stop`` and ``workers`` are as
    `slice_kernel` has them. It fills ``color`` float32 [V, H, W, 3] without background, ``alpha``
    [V, H, W] and ``depth`` [V, H, W] (along the optical axis, infinite where half the light
    passes).
    """
    build, cast = make_build(count), make_cast(count, way, 3)
    store, iota, floats = LANES.store, LANES.iota, LANES.floats
    sqrt, where = LANES.sqrt, LANES.where

    @identified("view row", count, way)
    @lean
    def _row(slab, marks, group_marks, nx, nz, shift, stride, camera, lattice, norm, begin, end,
             threshold, stop, lane, color, alpha, depth):
        """A row of one picture, from pixel ``begin`` to ``end``."""
        # In the lattice, where the eye is, and the way of the ray with slope 0 and what each unit
        # of slope adds to it.
        eye_i = np.float32(camera[3] * lattice[3] + lattice[6])
        eye_k = np.float32(camera[11] * lattice[5] + lattice[8])
        ahead_i, ahead_k = camera[2] * lattice[3], camera[10] * lattice[5]
        across_i, across_k = camera[0] * lattice[3], camera[8] * lattice[5]
        for x in range(begin, end, 16):
            side = (floats(iota()) + np.float32(x + 0.5 - camera[14])) * np.float32(1 / camera[12])
            length = sqrt(side * side + np.float32(norm * norm))
            inverse = np.float32(1.0) / (side * np.float32(across_k) + np.float32(ahead_k))
            slope = (side * np.float32(across_i) + np.float32(ahead_i)) * inverse
            start = eye_i - slope * eye_k
            red, green, blue, through, plane = cast(
                slab, marks, group_marks, nx, nz, shift, stride, start, slope,
                length * inverse * np.float32(-stride), np.float32(norm) / length, side / length,
                1, threshold, stop)
            store(lane, np.uintp(0), red)
            store(lane, np.uintp(16), green)
            store(lane, np.uintp(32), blue)
            store(lane, np.uintp(48), through)
            away = where(through < np.float32(0.5), (plane - eye_k) * inverse,
                         floats(np.float32(np.inf)))
            store(lane, np.uintp(64), away)
            for i in range(min(16, end - x)):
                color[x + i, 0] = lane[i]
                color[x + i, 1] = lane[16 + i]
                color[x + i, 2] = lane[32 + i]
                alpha[x + i] = np.float32(1.0) - lane[48 + i]
                depth[x + i] = lane[64 + i]

    @shared("workers")
    @identified("view render", count, way)
    @kernel
    def render(since, until, places, occupied, values, lattice, cameras, least, stride, threshold,
               stop, workers, color, alpha, depth):
        views, height, across = alpha.shape
        nx, ny, nz = np.int64(lattice[0]), np.int64(lattice[1]), np.int64(lattice[2])
        pitch = pitch_of(nx)
        shift = 0
        while (nx >> shift) > 63:
            shift += 1
        shape = np.array([nx, ny, nz])
        groups = (nz + GROUP * stride - 1) // (GROUP * stride)
        one = cameras[0]
        # Distance along the optical axis of the lattice's point (i, k).
        depth_i, depth_k = one[2] / lattice[3], one[10] / lattice[5]
        depth_0 = -(depth_i * lattice[6] + depth_k * lattice[8]
                    + one[2] * one[3] + one[10] * one[11])
        for worker in range(since, until):
            slab = np.zeros(nz * LINES * pitch, np.uint16)
            low, high = np.full(nz, nx), np.full(nz, -1)
            marks, group_marks = np.zeros(nz, np.uint64), np.zeros(groups, np.uint64)
            basis, scratch = np.zeros(count * 16, np.float32), np.zeros(80, np.float32)
            plane, along, side = np.zeros(3), np.zeros(3, np.float32), np.zeros(3, np.float32)
            lane = np.zeros(80, np.float32)
            for axis in range(3):
                side[axis] = one[4 * axis]
            for y in range(worker, height, workers):
                color[:, y] = np.float32(0.0)
                alpha[:, y] = np.float32(0.0)
                depth[:, y] = np.float32(np.inf)
                fall = (y + 0.5 - one[15]) / one[13]
                # The plane cuts (i, k) at lattice row plane[0] + plane[1] i + plane[2] k.
                lift = one[5] * fall * lattice[4]
                plane[0] = one[7] * lattice[4] + lattice[7] + lift * depth_0
                plane[1], plane[2] = lift * depth_i, lift * depth_k
                norm = np.sqrt(1.0 + fall * fall)
                for axis in range(3):
                    along[axis] = np.float32((one[4 * axis + 2] + fall * one[4 * axis + 1]) / norm)
                plane_matrix(side, along, count, least, basis, scratch)
                build(places, occupied, values, shape, plane, basis, threshold, shift, stride, slab,
                      low, high, marks)
                left, right, back, front = nx, -1, nz, -1
                for group in range(groups):
                    group_marks[group] = 0
                    first = nz - 1 - group * GROUP * stride
                    for k in range(first, max(first - GROUP * stride, -1), -stride):
                        if marks[k] == 0:
                            continue
                        group_marks[group] |= marks[k]
                        left, right = min(left, low[k]), max(right, high[k])
                        back, front = min(back, k), max(front, k)
                if front < 0:
                    continue
                for view in range(views):
                    begin, end = _columns(cameras[view], lattice, left - 1, right + 1, back, front,
                                          across)
                    _row(slab, marks, group_marks, nx, nz, shift, stride, cameras[view], lattice,
                         norm, begin, end, threshold, stop, lane, color[view, y], alpha[view, y],
                         depth[view, y])

    return render
