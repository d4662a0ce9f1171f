"""Training a field: rays forward with a record of their samples, then backward over the record.

Rays come in packets of 4x4 pixels, whose samples share bricks and colour rows. Going forward, the
density of 16 rays is interpolated in lanes, and each visible sample is written down (its cell, its
weight, its colour), 16 rays at a time. Going backward over the record, the colour still to come
behind each sample gives all of its gradients (Shen et al. 2023, Eq. 1, differentiated)::

    dC/dc_i     = w_i,      w_i = T_i (1 - exp(-sigma_i delta))
    dC/dsigma_i = delta (T_{i+1} c_i - (colour behind i)),   dA/dsigma_i = delta T_end

The distortion loss, sum_ij w_i w_j |t_i - t_j| + sum_i w_i^2 delta / 3 (Barron et al. 2022,
Mip-NeRF 360, Eq. 15), draws a ray's weights together: surfaces get thin, and a ray has fewer
samples.

Every worker adds into its own gradient arrays, which the optimiser sums in a fixed order: the same
seed gives the same bytes however the threads are scheduled.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, prange

from .identity import identified
from .lanes import LANES
from .march import enter_box, make_basis, make_locate

__all__ = ["train_kernel"]

_STEP = 160
"""Floats that a packet's sample takes in the record: fractions x, y, z; weight; transmittance
behind it; density; distance; red, green, blue; 16 lanes each."""


@functools.cache
def train_kernel(width: int) -> Callable[..., Any]:
    """The kernel for colour rows of 16 or 32 floats.

    Returns
    -------
    train
        ``train(table, links, density, rows, lattice, count, cameras, sizes, starts, pixels, gains,
        tiles, background, options, grad_rows, grad_background, touched, weight, losses)``;
        ``tiles`` int32 [T, 3] (view, first row, first column) in blocks of 4x4 pixels,
        ``cameras`` float64 [V, 16], ``sizes`` int64 [V, 2] (width, height), ``starts`` int64 [V]
        first pixel of each view in ``pixels`` uint8 [P, 4] (colour, composited by the kernel, and
        alpha), ``gains`` float32 [V, 3] what a view's 8-bit colours are multiplied with,
        ``background`` float32 [16 T, 3] and its gradient, written; ``options`` float64: step,
        threshold, stop, alpha weight, sparsity, distortion, 1 to record the largest weight only,
        distance from the camera that rays start at (world units). ``losses`` float64 [W, 3] is
        written: squared errors, rays, samples. Gradients are added to ``grad_rows``, the density's
        in the last value of its row, the weight of the rays that the row colours in the last but
        one; ``grad_rows``, ``touched``,
        ``weight`` and ``losses`` carry a leading axis of workers.
    """
    locate = make_locate(LANES)
    fill_basis = make_basis(width)
    floats, where, floor = LANES.floats, LANES.where, LANES.floor
    minimum, maximum, exp, gather = LANES.minimum, LANES.maximum, LANES.exp, LANES.gather
    bits, lowest, load, store = LANES.bits, LANES.lowest, LANES.load, LANES.store
    total, iota = LANES.total, LANES.iota
    two = width == 32
    one, zero = np.float32(1.0), np.float32(0.0)

    @identified("train corner_weights", width)
    @njit(cache=True)
    def corner_weights(x, y, z):
        return ((one - z) * (one - y) * (one - x), (one - z) * (one - y) * x,
                (one - z) * y * (one - x), (one - z) * y * x,
                z * (one - y) * (one - x), z * (one - y) * x, z * y * (one - x), z * y * x)

    @identified("train sample_color", width)
    @njit(cache=True)
    def sample_color(links, rows, base, weights, basis, start):
        first, rest = floats(zero), floats(zero)
        for corner in range(8):
            offset = (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1)
            row = np.uintp(links[np.uintp(base + offset)]) * np.uintp(width)
            first = first + weights[corner] * load(rows, row)
            if two:
                rest = rest + weights[corner] * load(rows, row + np.uintp(16))
        red = total(first * load(basis, start))
        if two:
            green = total(first * load(basis, start + np.uintp(16))
                          + rest * load(basis, start + np.uintp(32)))
            blue = total(rest * load(basis, start + np.uintp(48)))
        else:
            green = total(first * load(basis, start + np.uintp(16)))
            blue = total(first * load(basis, start + np.uintp(32)))
        return red + np.float32(0.5), green + np.float32(0.5), blue + np.float32(0.5)

    @identified("train scatter", width)
    @njit(cache=True)
    def scatter(links, base, weights, basis, start, red, green, blue, sigma, weight, grad_rows,
                touched):
        lane = iota()
        own = where(lane == np.int32(15), floats(sigma),
                    where(lane == np.int32(14), floats(weight), floats(zero)))
        if two:
            first = (load(basis, start) * red + load(basis, start + np.uintp(16)) * green)
            rest = (load(basis, start + np.uintp(32)) * green
                    + load(basis, start + np.uintp(48)) * blue + own)
        else:
            first = (load(basis, start) * red + load(basis, start + np.uintp(16)) * green
                     + load(basis, start + np.uintp(32)) * blue + own)
            rest = first
        for corner in range(8):
            offset = (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1)
            row = np.uintp(links[np.uintp(base + offset)])
            touched[row] = 1
            place = row * np.uintp(width)
            store(grad_rows, place, load(grad_rows, place) + weights[corner] * first)
            if two:
                place += np.uintp(16)
                store(grad_rows, place, load(grad_rows, place) + weights[corner] * rest)

    @identified("train setup_ray", width)
    @njit(cache=True)
    def setup_ray(camera, lattice, count, x, y, step, near, i, ray, basis, scratch):
        cx = (x + 0.5 - camera[14]) / camera[12]
        cy = (y + 0.5 - camera[15]) / camera[13]
        scale = 1.0 / np.sqrt(cx * cx + cy * cy + 1.0)
        wx = (camera[0] * cx + camera[1] * cy + camera[2]) * scale
        wy = (camera[4] * cx + camera[5] * cy + camera[6]) * scale
        wz = (camera[8] * cx + camera[9] * cy + camera[10]) * scale
        fill_basis(np.float32(wx), np.float32(wy), np.float32(wz), count, basis, 64 * i, scratch)
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

    @identified("train forward", width)
    @njit(cache=True)
    def forward(table, links, density, rows, nx, ny, nz, flat, step, threshold, stop, basis,
                places, words, record, out):
        ox, oy, oz = load(flat, 0), load(flat, 16), load(flat, 32)
        dx, dy, dz = load(flat, 48), load(flat, 64), load(flat, 80)
        start, end, delta = load(flat, 96), load(flat, 112), load(flat, 128)
        red, green, blue = floats(zero), floats(zero), floats(zero)
        spread = floats(zero)
        through, k, t = floats(one), floats(zero), start
        tiny = np.float32(1e-9)
        inverse_x = one / where((dx < tiny) & (dx > -tiny), tiny, dx)
        inverse_y = one / where((dy < tiny) & (dy > -tiny), tiny, dy)
        inverse_z = one / where((dz < tiny) & (dz > -tiny), tiny, dz)
        inverse_step = one / step
        alive = start < end
        count = 0
        limit = len(words)
        while bits(alive) != 0:
            px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
            brick, bx, by, bz, inner, fx, fy, fz = locate(table, px, py, pz, nx, ny, nz)
            vacant = brick < np.int32(0)
            advance = floats(one)
            if bits(alive & ~vacant) != 0:
                base = maximum(brick, np.int32(0)) * np.int32(128) + inner
                d000 = gather(density, gather(links, base))
                d001 = gather(density, gather(links, base + np.int32(1)))
                d010 = gather(density, gather(links, base + np.int32(5)))
                d011 = gather(density, gather(links, base + np.int32(6)))
                d100 = gather(density, gather(links, base + np.int32(25)))
                d101 = gather(density, gather(links, base + np.int32(26)))
                d110 = gather(density, gather(links, base + np.int32(30)))
                d111 = gather(density, gather(links, base + np.int32(31)))
                d00, d01 = d000 + fx * (d001 - d000), d010 + fx * (d011 - d010)
                d10, d11 = d100 + fx * (d101 - d100), d110 + fx * (d111 - d110)
                d0, d1 = d00 + fy * (d01 - d00), d10 + fy * (d11 - d10)
                sigma = d0 + fz * (d1 - d0)
                shown = alive & ~vacant & (sigma > threshold)
                word = bits(shown)
                if word != 0 and count < limit:
                    fade = where(shown, exp(-(sigma * delta)), one)
                    weight = through * (one - fade)
                    through = through * fade
                    here = np.uintp(count) * np.uintp(_STEP)
                    lane_base = np.uintp(count) * np.uintp(16)
                    store(places, lane_base, base)
                    store(record, here, fx)
                    store(record, here + np.uintp(16), fy)
                    store(record, here + np.uintp(32), fz)
                    store(record, here + np.uintp(48), weight)
                    store(record, here + np.uintp(64), through)
                    store(record, here + np.uintp(80), sigma)
                    store(record, here + np.uintp(96), t)
                    words[count] = word
                    while word != 0:
                        lane = np.uintp(lowest(word))
                        word &= word - np.uint32(1)
                        at = here + lane
                        cr, cg, cb = sample_color(
                            links, rows, places[lane_base + lane],
                            corner_weights(record[at], record[at + np.uintp(16)],
                                           record[at + np.uintp(32)]),
                            basis, lane * np.uintp(64))
                        record[at + np.uintp(112)] = cr
                        record[at + np.uintp(128)] = cg
                        record[at + np.uintp(144)] = cb
                    red = red + weight * where(shown, load(record, here + np.uintp(112)), zero)
                    green = green + weight * where(shown, load(record, here + np.uintp(128)), zero)
                    blue = blue + weight * where(shown, load(record, here + np.uintp(144)), zero)
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
        store(out, 0, red)
        store(out, 16, green)
        store(out, 32, blue)
        store(out, 48, through)
        store(out, 64, spread)
        return count

    @identified("train backward", width)
    @njit(cache=True)
    def backward(links, count, flat, grads, out, sparsity, narrow, step, basis, places, words,
                 record, grad_rows, touched):
        red, green, blue = load(grads, 0), load(grads, 16), load(grads, 32)
        # What lies behind all samples: the background.
        red_behind, green_behind, blue_behind = load(grads, 48), load(grads, 64), load(grads, 80)
        opacity_slope = load(grads, 96)
        delta = load(flat, 128)
        # Distances enter the distortion loss in world units: one step is delta long.
        unit = delta / step
        weight_all, spread_all = one - load(out, 48), load(out, 64)
        weight_behind, spread_behind, pull_behind = floats(zero), floats(zero), floats(zero)
        slopes = out
        for entry in range(count - 1, -1, -1):
            here = np.uintp(entry) * np.uintp(_STEP)
            lane_base = np.uintp(entry) * np.uintp(16)
            word = words[entry]
            weight, through = load(record, here + np.uintp(48)), load(record, here + np.uintp(64))
            sigma, t = load(record, here + np.uintp(80)), load(record, here + np.uintp(96))
            shown = weight > zero
            r = where(shown, load(record, here + np.uintp(112)), zero)
            g = where(shown, load(record, here + np.uintp(128)), zero)
            b = where(shown, load(record, here + np.uintp(144)), zero)
            store(slopes, 80, where(r > zero, red * weight, zero))
            store(slopes, 96, where(g > zero, green * weight, zero))
            store(slopes, 112, where(b > zero, blue * weight, zero))
            r, g, b = maximum(r, zero), maximum(g, zero), maximum(b, zero)
            slope = (opacity_slope + red * (through * r - red_behind)
                     + green * (through * g - green_behind) + blue * (through * b - blue_behind))
            red_behind = red_behind + weight * r
            green_behind = green_behind + weight * g
            blue_behind = blue_behind + weight * b
            # d/dw of sum w_i w_j |t_i - t_j| + sum w_i^2 step / 3, carried to sigma like a colour.
            before, spread_before = (weight_all - weight_behind - weight,
                                     spread_all - spread_behind - weight * t)
            pull = np.float32(2.0) * unit * (
                t * (before - weight_behind) - spread_before + spread_behind
                + weight * (step / np.float32(3.0)))
            slope = slope + narrow * (through * pull - pull_behind)
            pull_behind = pull_behind + weight * pull
            weight_behind, spread_behind = weight_behind + weight, spread_behind + weight * t
            # Cauchy sparsity, d/dsigma log(1 + 2 sigma^2).
            slope = delta * slope + sparsity * np.float32(4.0) * sigma / (
                one + np.float32(2.0) * sigma * sigma)
            store(slopes, 128, slope)
            while word != 0:
                lane = np.uintp(lowest(word))
                word &= word - np.uint32(1)
                at = here + lane
                weights = corner_weights(record[at], record[at + np.uintp(16)],
                                         record[at + np.uintp(32)])
                scatter(links, places[lane_base + lane], weights, basis, lane * np.uintp(64),
                        slopes[np.uintp(80) + lane], slopes[np.uintp(96) + lane],
                        slopes[np.uintp(112) + lane], slopes[np.uintp(128) + lane],
                        record[at + np.uintp(48)], grad_rows, touched)

    @identified("train largest", width)
    @njit(cache=True)
    def largest(links, count, places, words, record, seen):
        for entry in range(count):
            word = words[entry]
            while word != 0:
                lane = np.uintp(lowest(word))
                word &= word - np.uint32(1)
                place = places[np.uintp(entry) * np.uintp(16) + lane]
                value = record[np.uintp(entry) * np.uintp(_STEP) + np.uintp(48) + lane]
                for corner in range(8):
                    offset = (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1)
                    row = np.uintp(links[np.uintp(place + offset)])
                    seen[row] = max(seen[row], value)

    @identified("train", width)
    @njit(cache=True, parallel=True)
    def train(table, links, density, rows, lattice, count, cameras, sizes, starts, pixels, gains,
              tiles, background, options, grad_rows, grad_background, touched, weight_seen, losses):
        workers = len(losses)
        step, threshold, stop = (np.float32(options[0]), np.float32(options[1]),
                                 np.float32(options[2]))
        alpha_weight, sparsity = np.float32(options[3]), np.float32(options[4])
        narrow, only_weights = np.float32(options[5]), options[6] > 0.5
        near = options[7]
        nx, ny, nz = np.int32(lattice[0]), np.int32(lattice[1]), np.int32(lattice[2])
        share = np.float32(1.0 / (16.0 * len(tiles)))
        samples = int(np.sqrt(float(nx) * nx + float(ny) * ny + float(nz) * nz) / step) + 2
        for worker in prange(workers):
            basis = np.zeros(16 * 64, np.float32)
            scratch = np.zeros(16, np.float32)
            ray = np.zeros((9, 16), np.float32)
            flat = ray.reshape(9 * 16)
            out = np.zeros(9 * 16, np.float32)
            grads = np.zeros(7 * 16, np.float32)
            places, words = np.zeros(16 * samples, np.int32), np.zeros(samples, np.uint32)
            record = np.zeros(samples * _STEP, np.float32)
            squared, used, visible = 0.0, 0, 0
            for tile in range(worker, len(tiles), workers):
                view = tiles[tile, 0]
                wide, high = sizes[view, 0], sizes[view, 1]
                for i in range(16):
                    x = min(tiles[tile, 2] + (i & 3), wide - 1)
                    y = min(tiles[tile, 1] + (i >> 2), high - 1)
                    setup_ray(cameras[view], lattice, count, x, y, step, near, i, ray, basis,
                              scratch)
                found = forward(table, links, density, rows, nx, ny, nz, flat, step, threshold,
                                stop, basis, places, words, record, out)
                if only_weights:
                    largest(links, found, places, words, record, weight_seen[worker])
                    continue
                for i in range(16):
                    x = min(tiles[tile, 2] + (i & 3), wide - 1)
                    y = min(tiles[tile, 1] + (i >> 2), high - 1)
                    pixel = starts[view] + y * wide + x
                    opacity = np.float32(pixels[pixel, 3]) / np.float32(255.0)
                    end = out[48 + i]
                    for channel in range(3):
                        ground = background[16 * tile + i, channel]
                        truth = (np.float32(pixels[pixel, channel]) * gains[view, channel] * opacity
                                 + (one - opacity) * ground)
                        error = out[16 * channel + i] + end * ground - truth
                        squared += error * error
                        slope = np.float32(2.0) * error * share / np.float32(3.0)
                        grads[16 * channel + i] = slope
                        grads[48 + 16 * channel + i] = end * ground
                        grad_background[16 * tile + i, channel] = slope * end
                    grads[96 + i] = (np.float32(2.0) * alpha_weight * (one - end - opacity) * share
                                     * end)
                used += 16
                for entry in range(found):
                    word = words[entry]
                    while word != 0:
                        visible += 1
                        word &= word - np.uint32(1)
                backward(links, found, flat, grads, out, sparsity * share, narrow * share, step,
                         basis, places, words, record, grad_rows[worker], touched[worker])
            losses[worker, 0], losses[worker, 1], losses[worker, 2] = squared, used, visible
    return train
