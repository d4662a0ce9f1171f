"""Signed distance of the hair of a modelled head, and the course of its strands.

Hair is a layer over the skull whose thickness grows behind the hairline, with relief along strands
that run from the face to a whorl or a knot. To it come, where the model has them, a fringe and hair
that hangs beside and behind the neck. Curly hair is a thick shell of round bumps.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

import numpy as np

from lfportrait.simd.decorators import lean

from .implicit import bump, carve, ellipsoid, noise, smooth_step, uniform, union

__all__ = ["curls", "hair_coordinates", "hair_cover", "hair_distance"]


@lean
def hair_coordinates(m, x, y, z):
    """Strand angle about the pole (radians) and angle from the pole (0..pi).

    On the knot the strands wind about an axis of their own; on a full beard they hang down, on its
    moustache they run to the sides.
    """
    kx, ky, kz = x, y - m.hair_pole_y, z - m.hair_pole_z
    if kx * kx + ky * ky + kz * kz < (1.18 * m.hair_knot) ** 2:
        turn = atan2(kx, 0.6 * ky - 0.8 * kz)
        height = (0.8 * ky + 0.6 * kz) / m.hair_knot
        return 0.5 * turn + 1.9 * height + 0.05 * noise(3.0 * turn, 4.0 * height, 1.0), 0.6 + (
            0.25 * cos(turn))
    if m.beard_full > 0.0 and y < -0.10 and z > -0.06:
        if y > -0.41 - 0.25 * abs(x) and abs(x) < 0.19:
            return 2.5 * y + 1.1 * abs(x), 5.0 * x
        return atan2(x, z + 0.10) + 0.05 * noise(6.0 * x, 9.0 * y, 6.0 * z), 1.2 - 2.0 * y
    py, pz = y - 0.10, z + 0.02
    ay, az = m.hair_pole_y - 0.10, m.hair_pole_z + 0.02
    if m.hair_length > 0.0:
        # What hangs, hangs straight down.
        az *= smooth_step(-0.40, 0.45, y)
    scale = 1.0 / sqrt(ay * ay + az * az)
    ay, az = ay * scale, az * scale
    along = py * ay + pz * az
    across = py * az - pz * ay
    side = sqrt(x * x + across * across) + 1e-9
    theta = atan2(side, along)
    wave = 0.020 * noise(7.0 * x, 7.0 * y, 7.0 * z)
    if m.hair_wave > 0.0:
        turn = atan2(x, -across)
        swing = sin(15.0 * y + 1.6 * noise(2.0 * turn, 1.2 * y, 3.0))
        wave += m.hair_wave * swing * smooth_step(0.45, -0.15, y)
    phi = atan2(x, -across)
    if m.hair_length > 0.0:
        # Beside the face strands lie next to each other from the ear forwards, then across the
        # front, where their place must not follow the relief: it would be ringed like wood.
        edge = m.hair_front + 0.70 * min(max(y, 0.0), 0.3) - 0.045
        beside = 0.29 + 2.7 * abs(x) - 1.6 * min(z, edge)
        near = smooth_step(-0.25, 0.05, z) * smooth_step(0.25, -0.40, y)
        phi += near * ((beside if x > 0.0 else -beside) - phi)
    return phi + m.hair_twist * theta + wave, theta


@lean
def hair_cover(m, ax, y, z, phi):
    """Positive where hair grows: distance behind the hairline, roughly, world units."""
    front = 0.62 * (y - 0.415 - m.hairline) - 0.80 * (z - 0.455) - 0.55 * max(0.20 - ax, 0.0) ** 2
    if m.hair_recede > 0.0:
        front -= m.hair_recede * smooth_step(0.12, 0.42, y) * (0.55 + 0.45 * smooth_step(0.04, 0.22,
                                                                                       ax))
    temple = 0.62 * (y - 0.03) - 0.80 * (z - 0.145)
    front = union(front, temple, 0.10)
    ear = sqrt(((z + 0.075) / 0.120) ** 2 + ((y + 0.105) / 0.205) ** 2) - 1.0
    ear = max(ear * 0.13, 0.10 * (z - 0.02))
    nape = 0.9 * (y + 0.25) - 0.25 * (z + 0.35)
    bottom = y + 0.14 if z > -0.06 else nape
    return min(min(front, ear), bottom) + 0.010 * noise(12.0 * phi, 3.0 * y, 0.0)


@lean
def curls(x, y, z):
    """Height in [0, 1] of round bumps that stand close together, and finer ones on them."""
    u, v, w = 15.0 * x + 0.3 * y, 15.0 * y - 0.3 * z, 15.0 * z + 0.3 * x
    i, j, k = int(np.floor(u)), int(np.floor(v)), int(np.floor(w))
    nearest = 9.0
    for c in range(-1, 2):
        for b in range(-1, 2):
            for a in range(-1, 2):
                dx = u - (i + a + uniform(i + a, j + b, 3 * (k + c)))
                dy = v - (j + b + uniform(i + a, j + b, 3 * (k + c) + 1))
                dz = w - (k + c + uniform(i + a, j + b, 3 * (k + c) + 2))
                nearest = min(nearest, dx * dx + dy * dy + dz * dz)
    return 0.66 * max(1.0 - nearest, 0.0) + 0.20 * abs(noise(2.3 * u, 2.3 * v, 2.3 * w)) + (
        0.14 * abs(noise(5.7 * v, 5.7 * w, 5.7 * u)))


@lean
def _relief(phi, theta):
    """Height of locks and strands, about [-1, 1]."""
    return 0.42 * noise(phi * 9.0, theta * 1.3, 2.0) + 0.36 * noise(
        phi * 23.0, theta * 2.0, 5.0) + 0.22 * noise(phi * 61.0, theta * 3.0, 7.0)


@lean
def hair_distance(m, x, ax, y, z, bone):
    """All the hair but the beard; ``bone`` is the distance to what it grows on."""
    d = _scalp(m, x, ax, y, z, bone)
    return union(d, _hanging(m, x, ax, y, z), 0.06) if m.hair_length > 0.0 else d


@lean
def _scalp(m, x, ax, y, z, bone):
    """Hair over the skull, with relief along the strands; the knot and the fringe."""
    knot = 10.0
    if m.hair_knot > 0.0:
        kx, ky, kz = x, y - m.hair_pole_y, z - m.hair_pole_z
        r = sqrt(kx * kx + ky * ky + kz * kz)
        knot = r - m.hair_knot
        if abs(knot) < 0.06:
            phi, theta = hair_coordinates(m, x, y, z)
            knot += 0.016 * noise(phi * 5.0, theta, 4.0) + 0.006 * noise(phi * 14.0, theta, 9.0)
    deep = max(m.hair_curl + max(m.hair_top, m.hair_side) - 0.16, 0.0)
    if bone > 0.30 + deep or bone < -0.12:
        return min(max(bone - 0.16 - deep, 0.05) if bone > 0.0 else 0.05, knot)
    phi, theta = hair_coordinates(m, x, y, z)
    cover = hair_cover(m, ax, y, z, phi)
    high = smooth_step(-0.05, 0.45, y)
    thick = m.hair_side + (m.hair_top - m.hair_side) * high
    thick += m.hair_quiff * bump(x, z, 0.03, 0.30, 0.42, 0.34) * high
    if m.hair_curl > 0.0:
        d = carve(bone - thick, cover, 0.14)
        return d - m.hair_curl * curls(x, y, z) if d < 0.10 + m.hair_curl else d - m.hair_curl
    grown = min(max(cover / 0.25, -0.5), 1.0)
    rise = grown * (2.0 - grown) if grown > 0.0 else 2.0 * grown
    d = bone - thick * rise - 0.002
    if d < 0.07:
        relief = _relief(phi, theta)
        d -= 0.020 * m.hair_relief * relief * smooth_step(0.0, 0.5, theta) * (0.25 + 0.75 * max(
            grown, 0.0))
    if m.hair_parting > 0.0:
        d += m.hair_parting * bump(x, z, 0.0, 0.14, 0.040, 0.40) * high
    if m.hair_fringe > 0.0:
        d = union(d, _fringe(m, ax, y, z, bone, phi, theta), 0.04)
    return union(d, knot, 0.05)


@lean
def _fringe(m, ax, y, z, bone, phi, theta):
    """A sheet of hair over the forehead that ends above the brows in uneven tips."""
    end = 0.160 + m.brow_height - 0.25 * ax * ax
    front = smooth_step(0.02, 0.30, z)
    d = bone - m.hair_fringe * front + 0.03 * (1.0 - front)
    if abs(d) < 0.09:
        d -= 0.014 * m.hair_relief * _relief(phi, theta)
        end += 0.022 * noise(phi * 11.0, 1.0, 3.0) + 0.016 * noise(phi * 31.0, 2.0, 6.0)
    return carve(d, y - end, 0.025)


@lean
def _hanging(m, x, ax, y, z):
    """Hair that hangs: a column about neck and head, open for face and throat."""
    low = smooth_step(0.10, -0.55, y)
    wide = (0.480 + 0.030 * low) * m.skull_width
    # Above the ears it draws in below the hair of the scalp.
    d = ellipsoid(x, max(y - 0.02, 0.0), z + 0.05, wide, 0.58, 0.56 - 0.05 * low)
    if d > 0.30:
        return d - 0.10
    front = m.hair_front + 0.70 * min(max(y, 0.0), 0.3) - z
    # It fills the corner behind the jaw.
    corner = 0.08 - 0.17 * smooth_step(-0.58, -0.36, y)
    throat = -union(corner + z, 0.325 * m.face_width - ax, 0.08)
    open_front = union(front, throat, 0.06)
    d = carve(d, open_front, 0.05)
    end = -m.hair_length
    if abs(d) < 0.12:
        phi, theta = hair_coordinates(m, x, y, z)
        d -= 0.024 * m.hair_relief * _relief(phi, theta)
        d -= 0.22 * m.hair_wave * noise(phi * 4.0, 3.5 * y, 8.0)
        end += 0.030 * noise(phi * 5.0, 1.0, 3.0) + 0.022 * noise(phi * 23.0, 2.0, 6.0)
    return carve(d, y - end, 0.04)
