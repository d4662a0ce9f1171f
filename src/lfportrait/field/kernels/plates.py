"""Compose what is behind a person from other views, whose colors are looked up on its surface."""

from __future__ import annotations

import numpy as np

from ...simd.decorators import lean_kernel
from ...simd.threads import shared

__all__ = ["compose_plate"]


@shared("inverse")
@lean_kernel
def compose_plate(  # type: ignore[no-untyped-def]
        since, until, inverse, wanted, camera, others, pictures, gains, enough, spread, scratch,
        color, noise, known):
    """Colors of a surface as other views show it, as one view sees it.

    The colors of the views are averaged, each by its weight and by how well it agrees with their
    mean (two steps of reweighting by Geman and McClure's function), so that few that show
    something else do not count. Views are asked in their order until their weights are ``enough``.

    Parameters
    ----------
    inverse
        float32 [h, w], one over the surface's distance along the optical axis of the view.
    wanted
        uint8 [h, w], zero where nothing is to be filled.
    camera, others
        float64 [16] and [K, 16]: pose row by row, focal, principal point in pixels.
    pictures
        uint8 [K, H, W, 4], sRGB and the weight of each pixel: how surely it shows the surface.
    gains
        float32 [K, 3], by which the colors of each picture are multiplied.
    enough
        Sum of weights after which no more views are asked.
    spread
        Difference of colors, in [0, 1], from which on they count as different.
    scratch
        float32 [h, K, 4], overwritten.
    color, noise, known
        float32 [h, w, 3], [h, w] and [h, w], filled: mean color in [0, 1], its standard deviation
        over the views (root of the channels' mean variance), and the sum of the weights.
    """
    width = inverse.shape[1]
    count, high, wide = pictures.shape[0], pictures.shape[1], pictures.shape[2]
    scale = np.float32(1.0 / 255.0)
    for y in range(since, until):
        samples = scratch[y]
        for x in range(width):
            if wanted[y, x] == 0:
                continue
            along = 1.0 / max(np.float64(inverse[y, x]), 1e-6)
            u = (x + 0.5 - camera[14]) / camera[12] * along
            v = (y + 0.5 - camera[15]) / camera[13] * along
            px = camera[0] * u + camera[1] * v + camera[2] * along + camera[3]
            py = camera[4] * u + camera[5] * v + camera[6] * along + camera[7]
            pz = camera[8] * u + camera[9] * v + camera[10] * along + camera[11]
            used, sum_of_weights = 0, np.float32(0.0)
            for k in range(count):
                if sum_of_weights >= enough:
                    break
                dx, dy, dz = px - others[k, 3], py - others[k, 7], pz - others[k, 11]
                far = others[k, 2] * dx + others[k, 6] * dy + others[k, 10] * dz
                if far <= 1e-6:
                    continue
                column = (others[k, 0] * dx + others[k, 4] * dy + others[k, 8] * dz) / far
                row = (others[k, 1] * dx + others[k, 5] * dy + others[k, 9] * dz) / far
                column = column * others[k, 12] + others[k, 14] - 0.5
                row = row * others[k, 13] + others[k, 15] - 0.5
                if not (0.0 <= column < wide - 1 and 0.0 <= row < high - 1):
                    continue
                left, top = int(column), int(row)
                a, b = np.float32(column - left), np.float32(row - top)
                one = np.float32(1.0)
                for channel in range(4):
                    upper = (pictures[k, top, left, channel] * (one - a)
                             + pictures[k, top, left + 1, channel] * a)
                    lower = (pictures[k, top + 1, left, channel] * (one - a)
                             + pictures[k, top + 1, left + 1, channel] * a)
                    samples[used, channel] = (upper * (one - b) + lower * b) * scale
                if samples[used, 3] > np.float32(0.004):
                    for channel in range(3):
                        samples[used, channel] *= gains[k, channel]
                    sum_of_weights += samples[used, 3]
                    used += 1
            red = green = blue = total = variance = np.float32(0.0)
            for step in range(3):
                r = g = h = mass = squared = np.float32(0.0)
                for k in range(used):
                    weight = samples[k, 3]
                    if step > 0:
                        away = ((samples[k, 0] - red) ** 2 + (samples[k, 1] - green) ** 2
                                + (samples[k, 2] - blue) ** 2)
                        near = spread * spread / (spread * spread + away)
                        weight *= near * near
                        squared += weight * away
                    r += weight * samples[k, 0]
                    g += weight * samples[k, 1]
                    h += weight * samples[k, 2]
                    mass += weight
                if mass > np.float32(0.0):
                    red, green, blue = r / mass, g / mass, h / mass
                    variance = squared / (np.float32(3.0) * mass)
                total = mass
            color[y, x, 0], color[y, x, 1], color[y, x, 2] = red, green, blue
            noise[y, x], known[y, x] = np.sqrt(variance), total
