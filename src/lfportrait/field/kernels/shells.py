"""The background: concentric spheres about the lattice's cube, with color and density.

Rays that leave the lattice go on through spheres whose inverse radii are evenly spaced from 1 to 0
(svox2's multi-sphere background). A sphere is an equirectangular map; a sample lies where the ray
meets it, and is interpolated between pixels and layers. The step that enters the opacity is the
difference of inverse radii, so that far layers count as much as near ones.

Coordinates: the cube [-1, 1]^3 of the lattice, whatever its box in the world. A map has ``2 R``
columns (longitude, atan2(x, z)) and ``R`` rows (latitude, +y first); only pixels that a photo sees
have data, float32 [N, layers, 4]: red, green, blue (svox2's zeroth harmonic, + 0.5) and density.
"""

import math

import numpy as np

from ...simd.decorators import identified, kernel, lean, lean_kernel
from ...simd.threads import shared
from .march import C0

_C0 = np.float32(C0)


@identified("shells meet")
@lean
def _meet(rays, ray, number, steps, inner):
    """Inverse radius, longitude, latitude (0 to 1) where a ray meets a sphere; (-1, 0, 0): not."""
    radius = steps / (steps - number - 0.5)
    if radius < inner:
        return -1.0, 0.0, 0.0
    ox, oy, oz = rays[ray, 0], rays[ray, 1], rays[ray, 2]
    dx, dy, dz = rays[ray, 3], rays[ray, 4], rays[ray, 5]
    along = ox * dx + oy * dy + oz * dz
    inside = along * along - (ox * ox + oy * oy + oz * oz) + radius * radius
    if inside < 0.0:
        return -1.0, 0.0, 0.0
    t = -along + math.sqrt(inside)
    if t <= 0.0:
        return -1.0, 0.0, 0.0
    inverse = 1.0 / radius
    x, y, z = (ox + t * dx) * inverse, (oy + t * dy) * inverse, (oz + t * dz) * inverse
    longitude = 0.5 + math.atan2(x, z) * (0.5 / math.pi)
    latitude = 0.5 - math.asin(min(1.0, max(-1.0, y))) / math.pi
    return inverse, longitude, latitude


@identified("shells inner")
@lean
def _inner(rays, ray):
    """Radius of the first sphere that counts: outside the unit sphere and met by the ray."""
    ox, oy, oz = rays[ray, 0], rays[ray, 1], rays[ray, 2]
    along = ox * rays[ray, 3] + oy * rays[ray, 4] + oz * rays[ray, 5]
    return max(1.0, math.sqrt(max(0.0, ox * ox + oy * oy + oz * oz - along * along)) + 1e-3)


@identified("shells corners")
@lean
def _corners(links, layers, inverse, longitude, latitude, rows, weights):
    """The eight corners of a sample: places in the data (-1 where there is none) and weights."""
    high = links.shape[1]
    wide = links.shape[0]
    u, v = longitude * wide, latitude * high
    w = min(max((1.0 - inverse) * layers - 0.5, 0.0), layers - 1.0)
    column, row = min(int(u), wide - 1), min(int(v), high - 1)
    layer = min(int(w), layers - 2)
    u, v, w = u - column, v - row, w - layer
    for corner in range(8):
        i = column + (corner & 1)
        j = row + ((corner >> 1) & 1)
        i = i - wide if i >= wide else i
        j = high - 1 if j >= high else j
        link = links[i, j]
        above = (corner >> 2) & 1
        rows[corner] = link * layers + layer + above if link >= 0 else -1
        weights[corner] = ((u if corner & 1 else 1.0 - u) * (v if corner & 2 else 1.0 - v)
                           * (w if above else 1.0 - w))


@identified("shells value")
@lean
def _value(data, rows, weights, channel):
    value = np.float32(0.0)
    for corner in range(8):
        if rows[corner] >= 0:
            value += weights[corner] * data[rows[corner], channel]
    return value


@shared("rays")
@lean_kernel
def shells_mark(since, until, rays, layers, seen):
    """Mark the map pixels (uint8 [2 R, R]) that rays (as `shells_forward`'s) look up."""
    wide, high = seen.shape
    steps = layers + 2
    for ray in range(since, until):
        inner = _inner(rays, ray)
        for number in range(steps):
            inverse, longitude, latitude = _meet(rays, ray, number, steps, inner)
            if inverse > 0.0:
                column, row = int(longitude * wide), int(latitude * high)
                for corner in range(4):
                    i, j = column + (corner & 1), row + (corner >> 1)
                    seen[i % wide, min(j, high - 1)] = 1


@shared("rays")
@kernel
def shells_forward(since, until, rays, links, data, layers, background, stop, color):
    """Color of each ray behind the lattice, float32 [K, 3].

    Parameters
    ----------
    rays : float32 [K, 6], origin and unit direction in the cube's coordinates.
    links : int32 [2 R, R], place of a map pixel's layers in the data, -1 where it has none.
    data : float32 [N * layers, 4].
    background : Grey level behind the last sphere.
    stop : A ray ends where its transmittance falls below this.
    """
    steps = layers + 2
    for ray in range(since, until):
        rows, weights = np.empty(8, np.int64), np.empty(8, np.float32)
        inner = _inner(rays, ray)
        last, through = 1.0 / inner, np.float32(1.0)
        red, green, blue = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for number in range(steps):
            inverse, longitude, latitude = _meet(rays, ray, number, steps, inner)
            if inverse < 0.0:
                continue
            _corners(links, layers, inverse, longitude, latitude, rows, weights)
            sigma = _value(data, rows, weights, 3)
            if sigma > 0.0:
                fade = np.float32(math.exp(-sigma * (last - inverse)))
                weight = through * (np.float32(1.0) - fade)
                red += weight * max(_C0 * _value(data, rows, weights, 0) + np.float32(0.5),
                                    np.float32(0.0))
                green += weight * max(_C0 * _value(data, rows, weights, 1) + np.float32(0.5),
                                      np.float32(0.0))
                blue += weight * max(_C0 * _value(data, rows, weights, 2) + np.float32(0.5),
                                     np.float32(0.0))
                through *= fade
                if through < stop:
                    break
            last = inverse
        color[ray, 0] = red + through * background
        color[ray, 1] = green + through * background
        color[ray, 2] = blue + through * background


@shared("gradients")
@kernel
def shells_backward(since, until, rays, links, data, layers, background, stop, color, slopes,
                    gradients):
    """Gradients of the data, added to float32 [workers, N * layers, 4].

    Parameters
    ----------
    color : float32 [K, 3], what `shells_forward` gave.
    slopes : float32 [K, 3], gradient of the loss with respect to ``color``; rays without are
        skipped.
    """
    steps = layers + 2
    workers = len(gradients)
    for worker in range(since, until):
        own = gradients[worker]
        rows, weights = np.empty(8, np.int64), np.empty(8, np.float32)
        for ray in range(worker, len(rays), workers):
            gr, gg, gb = slopes[ray, 0], slopes[ray, 1], slopes[ray, 2]
            if gr == 0.0 and gg == 0.0 and gb == 0.0:
                continue
            inner = _inner(rays, ray)
            last, through = 1.0 / inner, np.float32(1.0)
            # The color still to come, weighted by the slopes.
            behind = gr * color[ray, 0] + gg * color[ray, 1] + gb * color[ray, 2]
            for number in range(steps):
                inverse, longitude, latitude = _meet(rays, ray, number, steps, inner)
                if inverse < 0.0:
                    continue
                _corners(links, layers, inverse, longitude, latitude, rows, weights)
                sigma = _value(data, rows, weights, 3)
                if sigma > 0.0:
                    step = np.float32(last - inverse)
                    fade = np.float32(math.exp(-sigma * step))
                    weight = through * (np.float32(1.0) - fade)
                    through *= fade
                    red = _C0 * _value(data, rows, weights, 0) + np.float32(0.5)
                    green = _C0 * _value(data, rows, weights, 1) + np.float32(0.5)
                    blue = _C0 * _value(data, rows, weights, 2) + np.float32(0.5)
                    here = (gr * max(red, np.float32(0.0)) + gg * max(green, np.float32(0.0))
                            + gb * max(blue, np.float32(0.0)))
                    behind -= weight * here
                    slope = step * (through * here - behind)
                    red = _C0 * weight * gr if red > 0.0 else np.float32(0.0)
                    green = _C0 * weight * gg if green > 0.0 else np.float32(0.0)
                    blue = _C0 * weight * gb if blue > 0.0 else np.float32(0.0)
                    for corner in range(8):
                        row = rows[corner]
                        if row >= 0:
                            share = weights[corner]
                            own[row, 0] += share * red
                            own[row, 1] += share * green
                            own[row, 2] += share * blue
                            own[row, 3] += share * slope
                    if through < stop:
                        break
                last = inverse


@shared("data")
@lean_kernel
def shells_step(since, until, data, gradients, mean_square, rate_color, rate_density, decay):
    """One RMSProp step on values with a gradient; gradients are set to zero.

    ``data`` and ``mean_square`` are float32 [N * layers, 4], ``gradients`` [workers, N * layers,
    4].
    """
    workers = len(gradients)
    rest = np.float32(1.0) - decay
    for row in range(since, until):
        for channel in range(4):
            gradient = np.float32(0.0)
            for worker in range(workers):
                gradient += gradients[worker, row, channel]
                gradients[worker, row, channel] = np.float32(0.0)
            if gradient != np.float32(0.0):
                square = decay * mean_square[row, channel] + rest * gradient * gradient
                mean_square[row, channel] = square
                rate = rate_density if channel == 3 else rate_color
                value = data[row, channel] - rate * gradient / (np.sqrt(square)
                                                                + np.float32(1e-8))
                data[row, channel] = max(value, np.float32(0.0)) if channel == 3 else value
