"""Training a field: rays forward with a record of samples, then backward; many steps in a call.

Rays come in packets of 4x4 pixels, which share a small copy of the lattice
(`packet`). Going forward, the density of 16 rays is interpolated in lanes, and
each visible sample is written down (its cell, its weight, its color), 16 rays at a time. Going
backward, the color still to come behind each sample gives all of its gradients (Shen et al. 2023,
Eq. 1, differentiated)::

    dC/dc_i     = w_i,      w_i = T_i (1 - exp(-sigma_i delta))
    dC/dsigma_i = delta (T_{i+1} c_i - (color behind i)),   dA/dsigma_i = delta T_end

The distortion loss, sum_ij w_i w_j |t_i - t_j| + sum_i w_i^2 delta / 3 (Barron et al. 2022,
Mip-NeRF 360, Eq. 15), draws a ray's weights together: surfaces get thin, and a ray has fewer
samples.

Rays write nothing to the lattice. Each packet leaves one record a lattice point, sorted by
whose part of the lattice the point is in; `descent` takes them up in a fixed
order, so that the same seed gives the same bytes however the threads are scheduled.

A step has four parts, and no thread begins one before all have done the one before: rays are cast,
their records are taken up (`descent`), the rows of a run are compared with their neighbours, and
smoothed. From the second part on each row has an owner, worker (row / 64) modulo the number of
workers, whoever cast the rays that met it. The threads wait for each other in the kernel.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ...simd.decorators import identified, kernel, lean
from ...simd.interleaved import gather_signed
from ...simd.threads import meet, together, with_kernel
from ...simd.vectors import LANES
from .descent import smooth_rows, take_up_all, vary_rows
from .march import enter_box, make_basis, make_locate
from .packet import (
    OWNED,
    make_color_points,
    mix_color,
    mix_density,
    open_brick,
    scatter,
    slopes_of_errors,
    use_cell,
    write_records,
)

_STEP = 144
"""Floats that a packet's sample takes in its notes: fractions x, y, z; weight; transmittance
behind it; distance; red, green, blue; 16 lanes each."""


@functools.cache
def make_cast(width: int) -> Callable[..., Any]:
    """What one worker of so many does in a cast, for color rows of 16 or 32 floats.

    Returns
    -------
    cast : ``cast(worker, workers, table, links, density, rows, lattice, count, cameras, sizes,
        starts, pixels, gains, tiles, background, options, pad, records, bases, grad_background,
        weight, tile_errors, scratch)``, which gives the worker's squared errors, rays and
        samples; ``tiles`` int32 [T, 3] (view, first row, first column) in blocks of 4x4 pixels,
        ``cameras`` float64 [V, 16], ``sizes`` int64 [V, 2] (width, height), ``starts`` int64
        [V] first pixel of each view in ``pixels`` uint8 [P, 4] (color, composited by the
        kernel, and alpha), ``gains`` float32 [V, 3] what a view's 8-bit colors are multiplied
        with, ``background`` float32 [16 T, 3] and its gradient, written; ``options`` float64:
        step, threshold, stop, alpha weight, distortion, 1 to record the largest
        weight only, distance from the camera that rays start at (world units); ``pad`` and
        ``records`` from `packet`, the latter written; ``bases`` float32 [T, 64], written: the
        harmonics of each packet's middle direction as the vectors that rows are multiplied
        with. ``weight`` float32 [W, N + 1], raised to the largest weight of each row if only
        that is asked. ``tile_errors`` float32 [T], squared errors of each tile, are written.
        ``scratch`` is the worker's own, from `make_scratch`.
    """
    locate = make_locate(LANES)
    fill_basis, color_points = make_basis(width), make_color_points(width)
    floats, ints, where, floor = LANES.floats, LANES.ints, LANES.where, LANES.floor
    minimum, maximum, exp = LANES.minimum, LANES.maximum, LANES.exp
    bits, lowest, load, store = LANES.bits, LANES.lowest, LANES.load, LANES.store
    one, zero = np.float32(1.0), np.float32(0.0)

    @identified("train setup_ray", width)
    @lean
    def setup_ray(camera, lattice, x, y, step, near, i, ray):
        cx = (x + 0.5 - camera[14]) / camera[12]
        cy = (y + 0.5 - camera[15]) / camera[13]
        scale = 1.0 / np.sqrt(cx * cx + cy * cy + 1.0)
        wx = (camera[0] * cx + camera[1] * cy + camera[2]) * scale
        wy = (camera[4] * cx + camera[5] * cy + camera[6]) * scale
        wz = (camera[8] * cx + camera[9] * cy + camera[10]) * scale
        gx, gy, gz = wx * lattice[3], wy * lattice[4], wz * lattice[5]
        norm = np.sqrt(gx * gx + gy * gy + gz * gz)
        ox = np.float32(camera[3] * lattice[3] + lattice[6])
        oy = np.float32(camera[7] * lattice[4] + lattice[7])
        oz = np.float32(camera[11] * lattice[5] + lattice[8])
        dx, dy, dz = np.float32(gx / norm), np.float32(gy / norm), np.float32(gz / norm)
        start, end = enter_box(ox, oy, oz, dx, dy, dz, np.int32(lattice[0]), np.int32(lattice[1]),
                               np.int32(lattice[2]))
        start = max(start, np.float32(near * norm))
        ray[0, i], ray[1, i], ray[2, i] = ox, oy, oz
        ray[3, i], ray[4, i], ray[5, i] = dx, dy, dz
        ray[6, i], ray[7, i], ray[8, i] = start, end, np.float32(step / norm)
        return wx, wy, wz

    @identified("train setup_packet", width)
    @lean
    def setup_packet(tile, camera, size, lattice, count, step, near, ray, basis, scratch):
        """All rays, and the harmonics of their mean direction."""
        mx, my, mz = 0.0, 0.0, 0.0
        for i in range(16):
            x = min(tile[2] + (i & 3), size[0] - 1)
            y = min(tile[1] + (i >> 2), size[1] - 1)
            wx, wy, wz = setup_ray(camera, lattice, x, y, step, near, i, ray)
            mx, my, mz = mx + wx, my + wy, mz + wz
        norm = 1.0 / np.sqrt(mx * mx + my * my + mz * mz)
        fill_basis(np.float32(mx * norm), np.float32(my * norm), np.float32(mz * norm), count,
                   basis, 0, scratch)

    @identified("train open_bricks", width)
    @lean
    def open_bricks(brick, missing, numbers, links, density, place, opened, own_density, ready,
                    counts):
        """Open the bricks of the lanes that ``missing`` marks."""
        store(numbers, 0, brick)
        while missing != 0:
            lane = np.uintp(lowest(missing))
            missing &= missing - np.uint32(1)
            open_brick(numbers[lane], links, density, place, opened, own_density, ready, counts)

    @identified("train forward", width)
    @lean
    def forward(table, links, density, nx, ny, nz, flat, step, threshold, stop, places, words,
                notes, out, numbers, place, opened, own_density, ready, used, counts):
        """March through the densities; notes what is visible, and which points it takes."""
        ox, oy, oz = load(flat, 0), load(flat, 16), load(flat, 32)
        dx, dy, dz = load(flat, 48), load(flat, 64), load(flat, 80)
        start, end, delta = load(flat, 96), load(flat, 112), load(flat, 128)
        spread = floats(zero)
        through, k, t = floats(one), floats(zero), start
        tiny = np.float32(1e-9)
        inverse_x = one / where((dx < tiny) & (dx > -tiny), tiny, dx)
        inverse_y = one / where((dy < tiny) & (dy > -tiny), tiny, dy)
        inverse_z = one / where((dz < tiny) & (dz > -tiny), tiny, dz)
        inverse_step = one / step
        alive = start < end
        last_cell = ints(np.int32(-1))
        count = 0
        limit = len(words)
        while bits(alive) != 0:
            px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
            brick, bx, by, bz, inner, fx, fy, fz = locate(table, px, py, pz, nx, ny, nz)
            vacant = brick < np.int32(0)
            active = alive & ~vacant
            advance = floats(one)
            if bits(active) != 0:
                own = gather_signed(place, maximum(brick, np.int32(0)))
                missing = bits(active & (own < np.int32(0)))
                if missing != 0:
                    open_bricks(brick, missing, numbers, links, density, place, opened,
                                own_density, ready, counts)
                    own = gather_signed(place, maximum(brick, np.int32(0)))
                base = where(active, own, np.int32(0)) * np.int32(128) + inner
                sigma = mix_density(own_density, base, fx, fy, fz)
                shown = active & (sigma > threshold)
                word = bits(shown)
                if word != 0 and count < limit:
                    fade = where(shown, exp(-(sigma * delta)), one)
                    weight = through * (one - fade)
                    through = through * fade
                    here = np.uintp(count) * np.uintp(_STEP)
                    lane_base = np.uintp(count) * np.uintp(16)
                    store(places, lane_base, base)
                    store(notes, here, fx)
                    store(notes, here + np.uintp(16), fy)
                    store(notes, here + np.uintp(32), fz)
                    store(notes, here + np.uintp(48), weight)
                    store(notes, here + np.uintp(64), through)
                    store(notes, here + np.uintp(80), t)
                    words[count] = word
                    # Every other sample lies in the cell of the one before.
                    entered = bits(shown & (base != last_cell))
                    last_cell = where(shown, base, last_cell)
                    while entered != 0:
                        lane = np.uintp(lowest(entered))
                        entered &= entered - np.uint32(1)
                        use_cell(places[lane_base + lane], ready, used, counts)
                    spread = spread + weight * t
                    count += 1
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
        store(out, 48, through)
        store(out, 64, spread)
        return count

    @identified("train shade", width)
    @lean
    def shade(count, places, words, notes, colors, out):
        """Colors of all samples and of the rays; returns the number of samples."""
        red, green, blue = floats(zero), floats(zero), floats(zero)
        samples = 0
        for entry in range(count):
            here = np.uintp(entry) * np.uintp(_STEP)
            lane_base = np.uintp(entry) * np.uintp(16)
            word = words[entry]
            while word != 0:
                lane = np.uintp(lowest(word))
                word &= word - np.uint32(1)
                at = here + lane
                cr, cg, cb = mix_color(places[lane_base + lane], notes[at],
                                       notes[at + np.uintp(16)], notes[at + np.uintp(32)], colors)
                notes[at + np.uintp(96)] = cr
                notes[at + np.uintp(112)] = cg
                notes[at + np.uintp(128)] = cb
                samples += 1
            weight = load(notes, here + np.uintp(48))
            shown = weight > zero
            red = red + where(
                shown, weight * maximum(load(notes, here + np.uintp(96)), zero), zero)
            green = green + where(
                shown, weight * maximum(load(notes, here + np.uintp(112)), zero), zero)
            blue = blue + where(
                shown, weight * maximum(load(notes, here + np.uintp(128)), zero), zero)
        store(out, 0, red)
        store(out, 16, green)
        store(out, 32, blue)
        return samples

    @identified("train taught", width)
    @lean
    def taught(color, slope, weight):
        """Slope of a sample's color: one below zero, shown as zero, can only rise."""
        return where((color > zero) | (slope < zero), slope * weight, zero)

    @identified("train backward", width)
    @lean
    def backward(count, flat, grads, out, narrow, step, places, words, notes, slopes):
        red, green, blue = load(grads, 0), load(grads, 16), load(grads, 32)
        # What lies behind all samples: the background.
        red_behind, green_behind, blue_behind = load(grads, 48), load(grads, 64), load(grads, 80)
        opacity_slope = load(grads, 96)
        delta = load(flat, 128)
        # Distances enter the distortion loss in world units: one step is delta long.
        unit = delta / step
        weight_all, spread_all = one - load(out, 48), load(out, 64)
        weight_behind, spread_behind, pull_behind = floats(zero), floats(zero), floats(zero)
        for entry in range(count - 1, -1, -1):
            here = np.uintp(entry) * np.uintp(_STEP)
            lane_base = np.uintp(entry) * np.uintp(16)
            word = words[entry]
            weight, through = load(notes, here + np.uintp(48)), load(notes, here + np.uintp(64))
            t = load(notes, here + np.uintp(80))
            shown = weight > zero
            r = where(shown, load(notes, here + np.uintp(96)), zero)
            g = where(shown, load(notes, here + np.uintp(112)), zero)
            b = where(shown, load(notes, here + np.uintp(128)), zero)
            store(out, 80, taught(r, red, weight))
            store(out, 96, taught(g, green, weight))
            store(out, 112, taught(b, blue, weight))
            r, g, b = maximum(r, zero), maximum(g, zero), maximum(b, zero)
            slope = (opacity_slope + red * (through * r - red_behind)
                     + green * (through * g - green_behind) + blue * (through * b - blue_behind))
            red_behind = red_behind + weight * r
            green_behind = green_behind + weight * g
            blue_behind = blue_behind + weight * b
            # d/dw of sum w_i w_j |t_i - t_j| + sum w_i^2 step / 3, carried to sigma like a color.
            before, spread_before = (weight_all - weight_behind - weight,
                                     spread_all - spread_behind - weight * t)
            pull = np.float32(2.0) * unit * (
                t * (before - weight_behind) - spread_before + spread_behind
                + weight * (step / np.float32(3.0)))
            slope = slope + narrow * (through * pull - pull_behind)
            pull_behind = pull_behind + weight * pull
            weight_behind, spread_behind = weight_behind + weight, spread_behind + weight * t
            store(out, 128, delta * slope)
            while word != 0:
                lane = np.uintp(lowest(word))
                word &= word - np.uint32(1)
                at = here + lane
                scatter(places[lane_base + lane], notes[at], notes[at + np.uintp(16)],
                        notes[at + np.uintp(32)], out[np.uintp(80) + lane],
                        out[np.uintp(96) + lane], out[np.uintp(112) + lane],
                        notes[at + np.uintp(48)], out[np.uintp(128) + lane], slopes)

    @identified("train largest", width)
    @lean
    def largest(links, opened, count, places, words, notes, seen):
        for entry in range(count):
            word = words[entry]
            while word != 0:
                lane = np.uintp(lowest(word))
                word &= word - np.uint32(1)
                cell = places[np.uintp(entry) * np.uintp(16) + lane]
                brick = np.int64(opened[np.uintp(cell >> 7)])
                value = notes[np.uintp(entry) * np.uintp(_STEP) + np.uintp(48) + lane]
                for corner in range(8):
                    offset = (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1)
                    row = np.uintp(links[np.uintp(128 * brick + (cell & 127) + offset)])
                    seen[row] = max(seen[row], value)

    @identified("train cast", width)
    @lean
    def cast(worker, workers, table, links, density, rows, lattice, count, cameras, sizes, starts,
             pixels, gains, tiles, background, options, pad, records, bases, grad_background,
             weight_seen, tile_errors, scratch):
        step, threshold, stop = (np.float32(options[0]), np.float32(options[1]),
                                 np.float32(options[2]))
        alpha_weight, narrow = np.float32(options[3]), np.float32(options[4])
        only_weights, near = options[5] > 0.5, options[6]
        nx, ny, nz = np.int32(lattice[0]), np.int32(lattice[1]), np.int32(lattice[2])
        share = np.float32(1.0 / (16.0 * len(tiles)))
        empty = len(density) - 1
        (all_place, all_opened, all_density, all_colors, all_slopes, all_ready, all_used,
         all_counts) = pad
        all_keys, all_values, all_written, all_recent = records
        place, opened, own_density = all_place[worker], all_opened[worker], all_density[worker]
        colors, slopes, ready = all_colors[worker], all_slopes[worker], all_ready[worker]
        used, counts, written = all_used[worker], all_counts[worker], all_written[worker]
        keys, values, recent = all_keys[worker], all_values[worker], all_recent[worker]
        harmonics, ray, flat, out, grads, numbers, places, words, notes = scratch
        squared, rays, visible = 0.0, 0, 0
        for owner in range(workers):
            written[owner] = 0
        for number in range(worker, len(tiles), workers):
            tile, view = tiles[number], tiles[number, 0]
            basis = bases[number]
            counts[0], counts[1] = 0, 0
            setup_packet(tile, cameras[view], sizes[view], lattice, count, step, near, ray,
                         basis, harmonics)
            found = forward(table, links, density, nx, ny, nz, flat, step, threshold, stop,
                            places, words, notes, out, numbers, place, opened, own_density,
                            ready, used, counts)
            if only_weights:
                largest(links, opened, found, places, words, notes, weight_seen[worker])
            else:
                color_points(links, rows, opened, basis, colors, slopes, used, counts)
                visible += shade(found, places, words, notes, colors, out)
                error = slopes_of_errors(
                    number, tile, sizes[view], starts[view], pixels, gains[view], background,
                    alpha_weight, share, out, grads, grad_background)
                tile_errors[number] = error
                squared += error
                rays += 16
                backward(found, flat, grads, out, narrow * share, step, places, words, notes,
                         slopes)
                write_records(number, links, empty, opened, used, slopes, counts, keys, values,
                              written, recent)
            for brick in range(counts[0]):
                place[np.uintp(opened[np.uintp(brick)])] = -1
        return squared, rays, visible
    return cast


@kernel
def make_scratch(lattice, options):
    """A thread's scratch for `make_cast`: room for the samples of the longest ray."""
    longest = np.sqrt(lattice[0] * lattice[0] + lattice[1] * lattice[1] + lattice[2] * lattice[2])
    samples = int(longest / options[0]) + 3
    ray = np.zeros((9, 16), np.float32)
    return (np.zeros(16, np.float32), ray, ray.reshape(9 * 16), np.zeros(9 * 16, np.float32),
            np.zeros(7 * 16, np.float32), np.zeros(16, np.int32),
            np.empty(16 * samples, np.int32), np.empty(samples, np.uint32),
            np.empty(samples * _STEP, np.float32))


@lean
def _own_run(owner, workers, block, first, last):
    """The part of block ``block`` of a run that belongs to a worker, counted from ``first``."""
    if block % workers != owner:
        return 0, 0
    return max(OWNED * block, first) - first, min(OWNED * (block + 1), last) - first


@lean
def _vary(owner, workers, first, last, neighbours, density, rows, width, variation, slopes,
          color_slopes):
    """Slopes of the total variation of a worker's rows of a run."""
    for block in range(first // OWNED, (last - 1) // OWNED + 1):
        since, until = _own_run(owner, workers, block, first, last)
        if variation[0] > 0:
            vary_rows(since, until, neighbours, first, density, 1, variation[0], variation[2],
                      slopes)
        if variation[1] > 0:
            vary_rows(since, until, neighbours, first, rows, width, variation[1], variation[2],
                      color_slopes)


@lean
def _smooth(owner, workers, first, last, density, rows, width, variation, slopes, color_slopes,
            rate, decay, lowest, gains):
    """Take up those slopes."""
    length = last - first
    for block in range(first // OWNED, (last - 1) // OWNED + 1):
        since, until = _own_run(owner, workers, block, first, last)
        if variation[0] > 0:
            smooth_rows(since, until, density, rows, width, slopes[:length], first, last, rate,
                        decay, lowest, gains)
        if variation[1] > 0:
            smooth_rows(since, until, density, rows, width, color_slopes[:length * width], first,
                        last, rate, decay, lowest, gains)


@lean
def _fits(counts, room):
    """Whether there was room for all records."""
    for worker in range(len(counts)):
        for owner in range(len(counts)):
            if counts[worker, owner] > room:
                return False
    return True


@functools.cache
def steps_kernel(width: int) -> Callable[..., Any]:
    """The kernel for color rows of 16 or 32 floats.

    Returns
    -------
    steps : ``steps(number, threads, bell, done, alone, table, links, density, rows, lattice,
        count, cameras, sizes, starts, pixels, scale, tiles, grounds, options, pad, records,
        bases, grad_background, weight, neighbours, variation, rates, firsts, slopes,
        color_slopes, decay, lowest, gains, errors, losses)``, called `together`; see
        `make_cast` and `descend` for what is not named here. ``done`` int64 [threads], the
        steps that are done, read and written: less than all of them where there was too little
        room for the records of the next one. ``alone``: rays are cast, and that is all.
        ``tiles`` int32 [S, T, 3], ``grounds`` float32 [S, 16 T, 3], the backgrounds of their
        rays. ``variation`` float32 [3], weights of the density's and the colors' total
        variation by the length of a run, and the scale of differences. ``rates`` float32 [S,
        2], the density's rate and the colors' memory; ``firsts`` int64 [S], where each run
        begins; ``slopes`` [R] and ``color_slopes`` [R * width] float32, scratch of the run's
        length. ``errors`` float32 [S, T] and ``losses`` float64 [S, W, 3] are written.
    """
    cast = make_cast(width)

    @identified("take steps", width)
    @kernel
    def steps(number, threads, bell, done, alone, table, links, density, rows, lattice, count,
              cameras, sizes, starts, pixels, scale, tiles, grounds, options, pad, records, bases,
              grad_background, weight, neighbours, variation, rates, firsts, slopes, color_slopes,
              decay, lowest, gains, errors, losses):
        scratch = make_scratch(lattice, options)
        workers, points = losses.shape[1], len(density) - 1
        keys, values, written, _ = records
        flat = bases.reshape(-1)
        while done[number] < len(tiles):
            step = done[number]
            first = firsts[step]
            last = min(points, first + len(slopes))
            for worker in range(number, workers, threads):
                losses[step, worker, 0], losses[step, worker, 1], losses[step, worker, 2] = cast(
                    worker, workers, table, links, density, rows, lattice, count, cameras, sizes,
                    starts, pixels, scale, tiles[step], grounds[step], options, pad, records,
                    bases, grad_background, weight, errors[step], scratch)
            if alone:
                done[number] = step + 1
                continue
            if not meet(bell, threads) or not _fits(written, keys.shape[2]):
                return
            for worker in range(number, workers, threads):
                take_up_all(worker, worker + 1, keys, values, written, density, rows, width, flat,
                            rates[step, 0], decay, lowest, gains, rates[step, 1])
            if not meet(bell, threads):
                return
            for worker in range(number, workers, threads):
                _vary(worker, workers, first, last, neighbours, density, rows, width, variation,
                      slopes, color_slopes)
            if not meet(bell, threads):
                return
            for worker in range(number, workers, threads):
                _smooth(worker, workers, first, last, density, rows, width, variation, slopes,
                        color_slopes, rates[step, 0], decay, lowest, gains)
            done[number] = step + 1
            if not meet(bell, threads):
                return
    return steps


@functools.cache
def train_kernel(width: int) -> Callable[..., Any]:
    """One cast of rays alone, for color rows of 16 or 32 floats.

    Returns
    -------
    train : ``train(table, links, density, rows, lattice, count, cameras, sizes, starts, pixels,
        gains, tiles, background, options, pad, records, bases, grad_background, weight,
        tile_errors, losses)``: as `make_cast`, by all workers; ``losses`` float64 [W, 3] are
        written: squared errors, rays, samples.
    """
    steps = steps_kernel(width)
    # Not read in a cast alone.
    neighbours, none = np.zeros((1, 6), np.int32), np.zeros(3, np.float32)
    rates, firsts = np.zeros((1, 2), np.float32), np.zeros(1, np.int64)

    def train(table, links, density, rows, lattice, count, cameras, sizes, starts, pixels, gains,
              tiles, background, options, pad, records, bases, grad_background, weight,
              tile_errors, losses):
        together(steps, len(losses), np.zeros(len(losses), np.int64), True, table, links, density,
                 rows, lattice, count, cameras, sizes, starts, pixels, gains, tiles[None],
                 background[None], options, pad, records, bases, grad_background, weight,
                 neighbours, none, rates, firsts, none, none, none[0], none[0], none,
                 tile_errors[None], losses[None])
    return with_kernel(train, steps)
