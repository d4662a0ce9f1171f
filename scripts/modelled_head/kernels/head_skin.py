"""Colors of the modelled head: skin, brows, eyes, hair and cloth at a surface point.

All colors are linear albedos. Features are placed by the same curves that shape them (lid and
mouth lines of `head`), so that color and relief can't drift apart.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

import numpy as np

from lfportrait.simd.decorators import lean, lean_kernel

from .head import ear_distance, lid_lines, mouth_lines
from .head_hair import curls, hair_coordinates, hair_cover
from .implicit import bump, fractal, noise, smooth_step, uniform

__all__ = ["brow_cover", "brow_line", "cloth_albedo", "eye_albedo", "hair_albedo", "hair_tangent",
           "skin_albedo"]


@lean_kernel
def brow_line(m, ax):
    """Height of the middle of the brow at ``ax``, and the place along it (0 inner, 1 outer)."""
    t = (ax - 0.066 - 0.5 * m.eye_space) / 0.238
    bend = 1.0 - ((t - 0.60) / 0.60) ** 2
    return 0.108 + m.brow_height + 0.026 * m.brow_arch * bend, t


@lean
def brow_cover(m, x, y, z):
    """Cover of the skin by the brow's hairs, in [0, 1]."""
    ax = abs(x)
    line, t = brow_line(m, ax)
    if t < -0.15 or t > 1.15 or z < 0.1:
        return 0.0
    half = 0.0275 * m.brow_width * (1.0 - 0.70 * max(t, 0.0) ** 1.8)
    v = (y - line) / half
    # Hairs lean outwards; along the brow they fan from upright to level.
    lean = 0.9 + 1.3 * t
    across = (ax - 0.0) * 150.0 - v * half * 150.0 * lean
    hairs = 0.85 + 0.40 * noise(across, 5.0 + 1.3 * v, 20.0 if x > 0.0 else 40.0)
    body = smooth_step(1.15, 0.35, abs(v + 0.20 * noise(60.0 * ax, 2.0, 1.0 if x > 0.0 else 5.0)))
    return min(body * hairs * smooth_step(-0.12, 0.16, t) * smooth_step(1.10, 0.90, t), 1.0)


@lean
def _mix(a, b, w):
    return a[0] + (b[0] - a[0]) * w, a[1] + (b[1] - a[1]) * w, a[2] + (b[2] - a[2]) * w


@lean
def _scaled(a, r, g, b):
    return a[0] * r, a[1] * g, a[2] * b


@lean
def _freckle(x, y):
    """Cover of round spots of random place and size, at most one in a cell."""
    u, v = 52.0 * x, 52.0 * y
    i, j = int(np.floor(u)), int(np.floor(v))
    cover = 0.0
    for b in range(-1, 2):
        for a in range(-1, 2):
            dx = u - (i + a + uniform(i + a, j + b, 1))
            dy = v - (j + b + uniform(i + a, j + b, 2))
            size = 0.10 + 0.30 * uniform(i + a, j + b, 3) ** 2
            if uniform(i + a, j + b, 4) < 0.55:
                cover = max(cover, smooth_step(1.25, 0.5, sqrt(dx * dx + dy * dy) / size))
    return cover


@lean
def skin_albedo(m, x, y, z):
    """Albedo of the skin (lips, brows and lash line included) and its oiliness in [0, 1]."""
    ax = abs(x)
    color = m.skin
    mottle = fractal(9.0 * x, 9.0 * y, 9.0 * z)
    fine = noise(60.0 * x, 60.0 * y, 60.0 * z)
    tone = 1.0 + 0.035 * mottle + 0.022 * fine
    color = _scaled(color, tone, tone * (1.0 - 0.02 * mottle), tone * (1.0 - 0.03 * mottle))
    oil = 0.30
    if z > 0.0:
        flush = 0.55 * bump(ax, y, 0.235, -0.185, 0.185, 0.150)
        flush += 0.48 * bump(ax, y, 0.0, -0.215 - m.nose_length, 0.125, 0.105)
        flush += 0.18 * bump(ax, y, 0.0, -0.58, 0.14, 0.11)
        flush += 0.22 * bump(ax, y, 0.184, 0.035, 0.14, 0.060)
        color = _mix(color, m.blush, min(flush * (1.0 + 0.25 * mottle), 0.85))
        shade = 0.30 * bump(ax, y, 0.165, -0.052, 0.10, 0.045) + 0.22 * bump(
            ax, y, 0.105, 0.010, 0.055, 0.060)
        color = _scaled(color, 1.0 - 0.45 * shade, 1.0 - 0.70 * shade, 1.0 - 0.55 * shade)
        oil += 0.55 * bump(ax, y, 0.0, -0.17 - m.nose_length, 0.09, 0.16)
        oil += 0.30 * bump(ax, y, 0.0, 0.28, 0.26, 0.16) + 0.25 * bump(ax, y, 0.25, -0.10, 0.1, 0.1)
        if m.freckles > 0.0:
            where = bump(ax, y, 0.13, -0.125, 0.24, 0.15) * (0.75 + 0.5 * mottle)
            spot = m.freckles * where * _freckle(x, y)
            color = _scaled(color, 1.0 - 0.28 * spot, 1.0 - 0.45 * spot, 1.0 - 0.52 * spot)
    else:
        ear = smooth_step(0.40, 0.46, ax) * smooth_step(-0.35, -0.25, y)
        color = _mix(color, m.blush, 0.45 * ear)
    if m.beard > 0.0:
        line = -0.185 - 1.25 * max(0.26 - ax, 0.0)
        zone = smooth_step(0.05, -0.06, y - max(line, -0.30)) * smooth_step(-0.90, -0.62, y)
        zone *= smooth_step(-0.06, 0.06, z) * (1.0 - bump(ax, y, 0.0, -0.41, 0.17, 0.075))
        grain = 0.75 + 0.5 * noise(120.0 * x, 90.0 * y, 120.0 * z)
        color = _mix(color, m.brow, min(m.beard * zone * grain, 0.92))
        oil *= 1.0 - 0.6 * m.beard * zone
    if z > 0.15:
        color, oil = _features(m, x, ax, y, z, color, oil, mottle)
    phi, _ = hair_coordinates(m, x, y, z)
    cover = hair_cover(m, ax, y, z, phi)
    root = smooth_step(-0.045, 0.012, cover + 0.022 * noise(55.0 * phi, 2.0, 1.0))
    if ax > 0.3 and root > 0.0:
        root *= smooth_step(0.004, 0.030, ear_distance(m, ax, y, z))
    return (*_mix(color, m.hair, 0.9 * root), oil * (1.0 - root))


@lean
def _features(m, x, ax, y, z, color, oil, mottle):
    """Paint lips, lash line, lids and brows over the color of the skin."""
    upper, gap, lower, t = mouth_lines(m, ax)
    if t < 1.06:
        inside = smooth_step(-0.0055, 0.0055, upper - y) * smooth_step(-0.0075, 0.0055, y - lower)
        inside *= smooth_step(1.05, 0.93, t)
        wrinkle = noise(95.0 * x, 6.0 * y, 3.0)
        tone = 1.0 + 0.09 * wrinkle + 0.05 * mottle - (0.16 if y > gap else 0.0)
        color = _mix(color, _scaled(m.lips, tone, tone, tone), 0.88 * inside)
        line = (y - gap) / 0.0075
        dark = smooth_step(1.08, 0.92, t) / (1.0 + line * line * line * line)
        color = _scaled(color, 1.0 - 0.62 * dark, 1.0 - 0.76 * dark, 1.0 - 0.76 * dark)
        oil += 0.8 * inside * (1.0 if y < gap else 0.35) * (0.8 + 0.3 * wrinkle)
    top, bottom, e = lid_lines(m, ax)
    if abs(e) < 1.22:
        span = smooth_step(1.20, 0.96, abs(e))
        lash = smooth_step(0.0150 + 0.005 * e, 0.004, y - top)
        lash *= smooth_step(-0.03, -0.012, y - bottom)
        spike = 0.95 + 0.2 * noise(190.0 * ax + 60.0 * (y - top), 1.0, 2.0)
        if y < 0.5 * (top + bottom):
            lash = 0.42 * smooth_step(0.008, 0.001, bottom - y) * (0.35 + 0.4 * (e + 1.0))
        color = _mix(color, m.brow, min(0.93 * span * lash * spike, 0.95))
    cover = brow_cover(m, x, y, z)
    color = _mix(color, m.brow, 0.96 * cover)
    return color, oil * (1.0 - 0.8 * cover)


@lean
def eye_albedo(m, x, y, z):
    """Albedo of the eyeball and how much light the lids leave it."""
    ax = abs(x)
    cx = 0.184 + m.eye_space
    ex, ey = ax - cx, y
    if x < 0.0:
        ex = -ex
    r = sqrt(ex * ex + ey * ey)
    turn = atan2(ey, ex)
    upper, lower, t = lid_lines(m, ax)
    white = (0.74, 0.695, 0.66)
    corner = smooth_step(0.55, 1.0, abs(t))
    veins = 0.5 + 0.5 * noise(40.0 * ex, 160.0 * ey + 3.0 * noise(30.0 * ex, 9.0, 1.0), 3.0)
    color = _mix(white, (0.70, 0.42, 0.36), 0.45 * corner * (0.6 + 0.4 * veins))
    color = _mix(color, (0.62, 0.27, 0.23), smooth_step(-0.80, -0.93, t))
    size, pupil = 0.0405 * m.eye_size, 0.0150
    fibre = noise(turn * 9.0, r * 60.0, 1.0) * 0.5 + noise(turn * 24.0, r * 30.0, 2.0) * 0.5
    ring = smooth_step(pupil, 0.72 * size, r)
    tone = 1.0 + 0.55 * fibre
    iris = _scaled(m.iris, tone, tone, tone)
    # Amber near the pupil; below it the light that the cornea gathers.
    iris = _mix((1.3 * iris[0] + 0.07, 0.9 * iris[1] + 0.03, 0.5 * iris[2]), iris, ring)
    glow = 1.0 + 1.1 * smooth_step(0.010, -0.026, ey) * smooth_step(size, 0.5 * size, r)
    iris = _scaled(iris, glow, glow, glow)
    iris = _mix(iris, (0.012, 0.012, 0.014), 0.80 * smooth_step(0.80 * size, 1.0 * size, r))
    iris = _mix(iris, (0.004, 0.004, 0.005), smooth_step(pupil + 0.0025, pupil - 0.0015, r))
    color = _mix(color, iris, smooth_step(size + 0.0025, size - 0.0025, r))
    shade = 0.40 + 0.60 * smooth_step(-0.002, 0.024, upper - y)
    shade *= 0.80 + 0.20 * smooth_step(0.0, 0.010, y - lower)
    return color[0], color[1], color[2], shade


@lean
def hair_albedo(m, x, y, z):
    """Albedo of the hair: locks and strands between the model's two colors, dark at the roots."""
    phi, theta = hair_coordinates(m, x, y, z)
    lock = 0.5 + 0.5 * noise(phi * 9.0, theta * 1.3, 2.0)
    strand = 0.5 + 0.5 * noise(phi * 45.0, theta * 2.5, 11.0)
    thin = 0.5 + 0.5 * noise(phi * 130.0, theta * 4.0, 13.0)
    w = 0.26 * lock + 0.42 * strand + 0.32 * thin
    w = smooth_step(0.25, 0.95, w)
    if m.hair_curl > 0.0:
        lock = strand = curls(x, y, z)
        w = 0.7 * lock * lock + 0.3 * w
    dark = 0.68 + 0.32 * smooth_step(0.15, 0.6, 0.5 * lock + 0.5 * strand)
    color = _mix(m.hair, m.hair_light, w)
    return _scaled(color, dark, dark, dark)


@lean
def hair_tangent(m, x, y, z, nx, ny, nz):
    """Unit direction of the strand at a point with normal (nx, ny, nz)."""
    ay, az = m.hair_pole_y - 0.10, m.hair_pole_z + 0.02
    s = 1.0 / sqrt(ay * ay + az * az)
    ay, az = ay * s, az * s
    ax = 0.0
    if m.hair_curl > 0.0:
        # Curls point anywhere.
        ax, ay = noise(31.0 * x, 31.0 * y, 31.0 * z), ay + noise(31.0 * z, 31.0 * x, 31.0 * y)
    # Along a great circle to the pole, turned about the normal by the twist.
    dot = ax * nx + ay * ny + az * nz
    tx, ty, tz = ax - dot * nx, ay - dot * ny, az - dot * nz
    bx, by, bz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
    c, s = cos(0.7 * m.hair_twist), sin(0.7 * m.hair_twist)
    tx, ty, tz = c * tx + s * bx, c * ty + s * by, c * tz + s * bz
    s = 1.0 / sqrt(tx * tx + ty * ty + tz * tz + 1e-12)
    return tx * s, ty * s, tz * s


@lean
def cloth_albedo(m, x, y, z):
    """Albedo of the cloth: a knit with a slight heather."""
    turn = atan2(x, z)
    knit = noise(70.0 * turn, 110.0 * y, 1.0)
    tone = 1.0 + 0.14 * knit + 0.10 * fractal(7.0 * x, 7.0 * y, 7.0 * z)
    return _scaled(m.cloth, tone, tone, tone)
