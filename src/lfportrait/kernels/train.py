"""Training a field: rays forward with a record of their samples, then backward over the record.

Rays come in packets of 4x4 pixels, whose samples share bricks and colour rows. Going forward, the
density of 16 rays is interpolated in lanes, and each visible sample is written down (its cell, its
weight, its colour). Going backward over the record, the colour still to come behind each sample
gives all of its gradients (Shen et al. 2023, Eq. 1, differentiated)::

    dC/dc_i     = w_i,      w_i = T_i (1 - exp(-sigma_i delta))
    dC/dsigma_i = delta (T_{i+1} c_i - (colour behind i)),   dA/dsigma_i = delta T_end

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

__all__ = ["rmsprop", "total_variation", "train_kernel"]


@functools.cache
def train_kernel(width: int) -> Callable[..., Any]:
    """The kernel for colour rows of 16 or 32 floats.

    Returns
    -------
    train
        ``train(table, links, density, rows, lattice, count, cameras, sizes, starts, pixels, tiles,
        background, options, grad_density, grad_rows, touched, weight, losses)``; ``tiles`` int32
        [T, 3] (view, first row, first column) in blocks of 4x4 pixels, ``cameras`` float64 [V, 16],
        ``sizes`` int64 [V, 2] (width, height), ``starts`` int64 [V] first pixel of each view in
        ``pixels`` uint8 [P, 4] (colour composited by the kernel, alpha), ``background`` float32
        [T, 3], ``options`` float64: step, threshold, stop, alpha weight, sparsity, 1 to record the
        largest weight only. Workers' arrays carry a leading axis of workers.
    """
    locate = make_locate(LANES)
    fill_basis = make_basis(width)
    floats, where, floor = LANES.floats, LANES.where, LANES.floor
    minimum, maximum, exp, gather = LANES.minimum, LANES.maximum, LANES.exp, LANES.gather
    bits, lowest, lane_of, load, store = (LANES.bits, LANES.lowest, LANES.lane, LANES.load,
                                          LANES.store)
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
    def scatter(links, base, weights, basis, start, red, green, blue, sigma, grad_density,
                grad_rows, touched):
        if two:
            first = (load(basis, start) * red + load(basis, start + np.uintp(16)) * green)
            rest = (load(basis, start + np.uintp(32)) * green
                    + load(basis, start + np.uintp(48)) * blue)
        else:
            first = (load(basis, start) * red + load(basis, start + np.uintp(16)) * green
                     + load(basis, start + np.uintp(32)) * blue)
            rest = first
        for corner in range(8):
            offset = (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1)
            row = np.uintp(links[np.uintp(base + offset)])
            touched[row] = 1
            grad_density[row] += weights[corner] * sigma
            place = row * np.uintp(width)
            store(grad_rows, place, load(grad_rows, place) + weights[corner] * first)
            if two:
                place += np.uintp(16)
                store(grad_rows, place, load(grad_rows, place) + weights[corner] * rest)

    @identified("train setup_ray", width)
    @njit(cache=True)
    def setup_ray(camera, lattice, count, x, y, step, i, ray, basis, scratch):
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
        ray[0, i], ray[1, i], ray[2, i] = ox, oy, oz
        ray[3, i], ray[4, i], ray[5, i] = dx, dy, dz
        ray[6, i], ray[7, i], ray[8, i] = start, end, np.float32(step / norm)

    @identified("train forward", width)
    @njit(cache=True)
    def forward(table, links, density, rows, nx, ny, nz, flat, step, threshold, stop, basis,
                record_place, record_value, out):
        ox, oy, oz = load(flat, 0), load(flat, 16), load(flat, 32)
        dx, dy, dz = load(flat, 48), load(flat, 64), load(flat, 80)
        start, end, delta = load(flat, 96), load(flat, 112), load(flat, 128)
        red, green, blue = floats(zero), floats(zero), floats(zero)
        through, k, t = floats(one), floats(zero), start
        tiny = np.float32(1e-9)
        inverse_x = one / where((dx < tiny) & (dx > -tiny), tiny, dx)
        inverse_y = one / where((dy < tiny) & (dy > -tiny), tiny, dy)
        inverse_z = one / where((dz < tiny) & (dz > -tiny), tiny, dz)
        inverse_step = one / step
        alive = start < end
        count = 0
        limit = len(record_place)
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
                if word != 0:
                    fade = where(shown, exp(-(sigma * delta)), one)
                    weight = through * (one - fade)
                    r, g, b = floats(zero), floats(zero), floats(zero)
                    while word != 0 and count < limit:
                        lane = lowest(word)
                        word &= word - np.uint32(1)
                        place = lane_of(base, lane)
                        x, y, z = lane_of(fx, lane), lane_of(fy, lane), lane_of(fz, lane)
                        cr, cg, cb = sample_color(links, rows, place, corner_weights(x, y, z),
                                                  basis, np.uintp(lane) * np.uintp(64))
                        record_place[count, 0] = np.int32(lane)
                        record_place[count, 1] = place
                        record_value[count, 0], record_value[count, 1] = x, y
                        record_value[count, 2] = z
                        record_value[count, 3] = lane_of(weight, lane)
                        record_value[count, 4] = lane_of(through * fade, lane)
                        record_value[count, 5], record_value[count, 6] = cr, cg
                        record_value[count, 7], record_value[count, 8] = cb, lane_of(sigma, lane)
                        count += 1
                        here = iota() == np.int32(lane)
                        r, g = where(here, max(cr, zero), r), where(here, max(cg, zero), g)
                        b = where(here, max(cb, zero), b)
                    red, green, blue = red + weight * r, green + weight * g, blue + weight * b
                    through = through * fade
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
        return count

    @njit(cache=True, parallel=True)
    def train(table, links, density, rows, lattice, count, cameras, sizes, starts, pixels, tiles,
              background, options, grad_density, grad_rows, touched, weight_seen, losses):
        workers = len(losses)
        step, threshold, stop = (np.float32(options[0]), np.float32(options[1]),
                                 np.float32(options[2]))
        alpha_weight, sparsity = np.float32(options[3]), np.float32(options[4])
        only_weights = options[5] > 0.5
        nx, ny, nz = np.int32(lattice[0]), np.int32(lattice[1]), np.int32(lattice[2])
        share = np.float32(1.0 / (16.0 * len(tiles)))
        samples = int(np.sqrt(float(nx) * nx + float(ny) * ny + float(nz) * nz) / step) + 2
        for worker in prange(workers):
            basis = np.zeros(16 * 64, np.float32)
            scratch = np.zeros(16, np.float32)
            ray = np.zeros((9, 16), np.float32)
            flat = ray.reshape(9 * 16)
            out = np.zeros(64, np.float32)
            grad = np.zeros((16, 5), np.float32)
            record_place = np.empty((16 * samples, 2), np.int32)
            record_value = np.empty((16 * samples, 9), np.float32)
            my_density, my_rows = grad_density[worker], grad_rows[worker]
            my_touched, my_seen = touched[worker], weight_seen[worker]
            squared, used = 0.0, 0
            for tile in range(worker, len(tiles), workers):
                view = tiles[tile, 0]
                wide, high = sizes[view, 0], sizes[view, 1]
                for i in range(16):
                    x = min(tiles[tile, 2] + (i & 3), wide - 1)
                    y = min(tiles[tile, 1] + (i >> 2), high - 1)
                    setup_ray(cameras[view], lattice, count, x, y, step, i, ray, basis, scratch)
                found = forward(table, links, density, rows, nx, ny, nz, flat, step, threshold,
                                stop, basis, record_place, record_value, out)
                if only_weights:
                    for index in range(found):
                        place, value = record_place[index, 1], record_value[index, 3]
                        for corner in range(8):
                            offset = ((corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1))
                            row = links[place + offset]
                            my_seen[row] = max(my_seen[row], value)
                    continue
                for i in range(16):
                    x = min(tiles[tile, 2] + (i & 3), wide - 1)
                    y = min(tiles[tile, 1] + (i >> 2), high - 1)
                    pixel = starts[view] + y * wide + x
                    opacity = np.float32(pixels[pixel, 3]) / np.float32(255.0)
                    end = out[48 + i]
                    for channel in range(3):
                        ground = background[tile, channel]
                        truth = (np.float32(pixels[pixel, channel]) / np.float32(255.0) * opacity
                                 + (one - opacity) * ground)
                        seen = out[16 * channel + i] + end * ground
                        error = seen - truth
                        squared += error * error
                        grad[i, channel] = np.float32(2.0) * error * share / np.float32(3.0)
                        # What lies behind all samples: the background.
                        ray[channel, i] = end * ground
                    grad[i, 3] = np.float32(2.0) * alpha_weight * (one - end - opacity) * share
                    grad[i, 4] = end
                used += 16
                for index in range(found - 1, -1, -1):
                    lane = record_place[index, 0]
                    weight, after = record_value[index, 3], record_value[index, 4]
                    delta = ray[8, lane]
                    sigma = record_value[index, 8]
                    slope = grad[lane, 3] * grad[lane, 4]
                    red, green, blue = zero, zero, zero
                    for channel in range(3):
                        value = max(record_value[index, 5 + channel], zero)
                        behind = ray[channel, lane]
                        slope += grad[lane, channel] * (after * value - behind)
                        ray[channel, lane] = behind + weight * value
                    if record_value[index, 5] > zero:
                        red = grad[lane, 0] * weight
                    if record_value[index, 6] > zero:
                        green = grad[lane, 1] * weight
                    if record_value[index, 7] > zero:
                        blue = grad[lane, 2] * weight
                    slope = slope * delta
                    # Cauchy sparsity, d/dsigma log(1 + 2 sigma^2).
                    slope += sparsity * share * (np.float32(4.0) * sigma
                                                 / (one + np.float32(2.0) * sigma * sigma))
                    weights = corner_weights(record_value[index, 0], record_value[index, 1],
                                             record_value[index, 2])
                    scatter(links, record_place[index, 1], weights, basis,
                            np.uintp(lane) * np.uintp(64), red, green, blue, slope, my_density,
                            my_rows, my_touched)
            losses[worker, 0], losses[worker, 1] = squared, used
    return train


@njit(cache=True, parallel=True)
def rmsprop(values, width, used, gradients, touched, mean_square, rate, decay, epsilon, lowest,
            clear):
    """One RMSProp step on the rows that any worker touched; gradients are set to zero.

    Parameters
    ----------
    values, mean_square
        float32 [rows * width], parameters and their running mean squared gradient.
    width, used
        Row width, and how many of its values are parameters.
    gradients, touched
        float32 [workers, rows * width] and uint8 [workers, rows].
    rate, decay, epsilon
        Learning rate, decay of the running mean (0.95), floor of its root.
    lowest
        Parameters are kept at or above this.
    clear
        Whether to reset ``touched``, too.
    """
    workers = len(gradients)
    for row in prange(touched.shape[1] - 1):
        any_touched = False
        for worker in range(workers):
            if touched[worker, row] != 0:
                any_touched = True
        if any_touched:
            for i in range(row * width, row * width + used):
                gradient = np.float32(0.0)
                for worker in range(workers):
                    gradient += gradients[worker, i]
                    gradients[worker, i] = np.float32(0.0)
                square = decay * mean_square[i] + (np.float32(1.0) - decay) * gradient * gradient
                mean_square[i] = square
                value = values[i] - rate * gradient / (np.sqrt(square) + epsilon)
                values[i] = max(value, lowest)
            if clear:
                for worker in range(workers):
                    touched[worker, row] = 0


@njit(cache=True, parallel=True)
def total_variation(places, neighbours, first, last, values, width, used, weight, scale, gradient,
                    touched):
    """Gradient of total variation (Shen et al. 2023, Eq. 3) on a run of rows, into worker 0's.

    Each row gathers its own gradient from the differences that it takes part in, so that no two
    threads write the same place.

    Parameters
    ----------
    places
        int32 [rows], unused order of rows (identity keeps memory order).
    neighbours
        int32 [rows, 6]: next along x, y, z, previous along x, y, z; empty ones give the row itself.
    first, last
        Range of rows.
    weight
        Weight of the loss, divided by the number of rows in the range.
    scale
        Difference between neighbours is multiplied by this (resolution / 256).
    """
    small = np.float32(1e-9)
    for index in prange(first, last):
        row = places[index]
        touched[row] = 1
        for i in range(used):
            here = values[row * width + i]
            ex = (values[neighbours[row, 0] * width + i] - here) * scale
            ey = (values[neighbours[row, 1] * width + i] - here) * scale
            ez = (values[neighbours[row, 2] * width + i] - here) * scale
            slope = -(ex + ey + ez) / np.sqrt(ex * ex + ey * ey + ez * ez + small)
            for axis in range(3):
                before = neighbours[row, 3 + axis]
                if before != row:
                    there = values[before * width + i]
                    ax = (values[neighbours[before, 0] * width + i] - there) * scale
                    ay = (values[neighbours[before, 1] * width + i] - there) * scale
                    az = (values[neighbours[before, 2] * width + i] - there) * scale
                    own = ax if axis == 0 else (ay if axis == 1 else az)
                    slope += own / np.sqrt(ax * ax + ay * ay + az * az + small)
            gradient[row * width + i] += weight * scale * slope
