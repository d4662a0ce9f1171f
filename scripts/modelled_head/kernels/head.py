"""Signed distance of a modelled human head: the shape of the embedded capture and exemplars.

The head is a smooth union of ellipsoids and capsules (skull, face, jaw, cheekbones, nose, neck),
refined by smooth bumps of compact support in the frontal projection (sockets, folds, lips) and by
carving (mouth line, nostrils, the slit between the lids). Hair, beard and spectacles have modules
of their own: `head_hair`, `head_beard`, `head_worn`. Surfaces are kept apart, so that each can have
its own material: skin, hair, cloth, eyeballs and what is worn. Distances are approximate (a lower
bound up to a factor of about 0.7 near folds), exact in sign. The world is the portrait frame: +y
up, +z out of the face; one unit is about 17 cm.

The parameters ``m`` are one `modelled_head.HeadModel`.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from lfportrait.simd.decorators import lean, lean_kernel

from .head_beard import beard_distance
from .head_hair import hair_distance
from .head_worn import worn_distance
from .implicit import bump, capsule, carve, ellipsoid, noise, smooth_step, union

__all__ = ["bone_distance", "ear_distance", "face_distance", "lid_lines", "mouth_lines", "scene",
           "surfaces"]


@lean_kernel
def lid_lines(m, ax):
    """Height of the margins of the upper and lower lid at distance ``ax`` from the middle.

    Returns upper, lower and the place across the eye (-1 inner corner, 1 outer corner).
    """
    t = (ax - 0.184 - m.eye_space) / (0.086 * m.eye_size)
    s = max(1.0 - t * t, 0.0)
    beyond = 0.06 * max(abs(t) - 1.0, 0.0)
    level = 0.5 * (t + 1.0) * m.eye_tilt - 0.005
    upper = level + m.eye_size * m.eye_open * 0.0325 * s ** 0.75 * (1.0 - 0.15 * t) - beyond
    lower = level - m.eye_size * 0.0265 * s ** 0.95 * (1.0 + 0.22 * t) + beyond
    return upper, lower, t


@lean_kernel
def mouth_lines(m, ax):
    """Heights of the lips at distance ``ax`` from the middle: upper border, gap, lower border.

    The fourth value is the place across the mouth, 0 in the middle, 1 at the corner.
    """
    t = ax / (0.140 * m.mouth_width)
    s = max(1.0 - t * t, 0.0)
    base = -0.400 - 0.45 * m.chin_drop
    gap = base + m.smile * t * t + 0.006 * (1.0 - t) * t * t - 0.006 * bump(t, 0.0, 0.0, 0.0, 0.5,
                                                                             1.0)
    bow = 0.17 * bump(t, 0.0, 0.24, 0.0, 0.42, 1.0) - 0.14 * bump(t, 0.0, 0.0, 0.0, 0.26, 1.0)
    upper = gap + m.lip_upper * 0.044 * (s ** 1.05 * (0.90 - 0.10 * t) + bow)
    lower = gap - m.lip_lower * 0.056 * s ** 0.72 * (1.0 - 0.12 * t)
    return upper, gap, lower, t


@lean
def bone_distance(m, x, ax, y, z):
    """Skull and cheeks without features: what hair grows on."""
    d = ellipsoid(x, y - 0.175, z + 0.045, 0.415 * m.skull_width, 0.485, 0.545)
    return union(d, ellipsoid(x, y + 0.135, z - 0.125, 0.338 * m.face_width, 0.44, 0.375), 0.16)


@lean
def _nose(m, ax, y, z, d):
    """Blend the nose into the face distance ``d``; carve the nostrils."""
    low, out, wide = -m.nose_length, m.nose_out, m.nose_width
    bridge = capsule(ax, y, z, 0.0, 0.085, 0.478, 0.0, -0.180 + low, 0.612 + out, 0.031 * wide,
                      0.036 * wide)
    body = capsule(ax, y, z, 0.0, 0.040, 0.430, 0.0, -0.175 + low, 0.520 + 0.5 * out, 0.040 * wide,
                    0.056 * wide)
    d = union(d, body, 0.080)
    hump = 0.018 * m.nose_hump * bump(ax, y, 0.0, -0.03, 0.08, 0.10)
    d = union(d, bridge - hump, 0.100)
    d = union(d, ellipsoid(ax, y + 0.200 - low, z - 0.622 - out, 0.047 * wide, 0.042, 0.052),
               0.060)
    wing = ellipsoid(ax - 0.060 * wide, y + 0.218 - low, z - 0.560 - 0.4 * out, 0.029 * wide,
                      0.034, 0.054)
    d = union(d, wing, 0.034)
    d = union(d, capsule(ax, y, z, 0.0, -0.236 + low, 0.618 + out, 0.0, -0.258 + low, 0.540,
                           0.019, 0.022), 0.030)
    # The hole is a slanted ellipsoid that points up and inwards.
    hx, hy, hz = ax - 0.035 * wide, y + 0.250 - low, z - 0.586 - 0.7 * out
    hole = ellipsoid(hx - 0.30 * hz, hy, hz, 0.0185 * wide, 0.026, 0.036)
    return carve(d, hole, 0.014)


@lean
def _lips(m, ax, y, z, d):
    """Shape of the lips, the groove above them and the hollow below them."""
    upper, gap, lower, t = mouth_lines(m, ax)
    middle = 0.5 * (gap + upper)
    if t < 1.25:
        fade = smooth_step(1.02, 0.55, t)
        top = upper - gap + 1e-3
        u = (y - middle) / (0.5 * top + 0.004)
        full = 0.016 * m.lip_upper ** 0.5 * fade
        if abs(u) < 1.0:
            d -= full * (1.0 - u * u) * (1.0 - 0.25 * u)
        v = (y - 0.5 * (gap + lower)) / (0.5 * (gap - lower) + 0.006)
        if abs(v) < 1.0:
            d -= 0.022 * m.lip_lower ** 0.5 * fade * (1.0 - v * v) * (1.0 + 0.15 * v)
        groove = (y - gap) / 0.012
        d += 0.017 * smooth_step(1.12, 0.80, t) / (1.0 + groove * groove * groove * groove)
    corner = 0.140 * m.mouth_width
    d += 0.007 * bump(ax, y, corner + 0.010, gap, 0.050, 0.045)
    d -= 0.006 * bump(ax, y, corner + 0.065, gap - 0.005, 0.080, 0.100)
    d += 0.008 * bump(ax, y, 0.0, upper + 0.030, 0.030, 0.065)
    d -= 0.003 * bump(ax, y, 0.034, upper + 0.030, 0.034, 0.065)
    return d + 0.020 * bump(ax, y, 0.0, lower - 0.030, 0.160, 0.065)


@lean
def _eyes(m, ax, y, z, d):
    """Sockets, lids with their fold, and the slit through which the eyeball is seen."""
    cx = 0.184 + m.eye_space
    d += 0.038 * bump(ax, y, cx - 0.060, 0.004, 0.125, 0.110)
    d += 0.020 * bump(ax, y, cx + 0.02, 0.040, 0.17, 0.075)
    ex, ez = ax - cx, z - 0.385
    radius = sqrt(ex * ex + y * y + ez * ez)
    rim = capsule(ax, y, z, cx + 0.100, 0.080, 0.350, cx + 0.095, -0.060, 0.345, 0.032, 0.034)
    d = union(d, rim, 0.090)
    if ez < -0.11 or radius > 0.28:
        return d
    upper, lower, t = lid_lines(m, ax)
    d = union(d, radius - 0.0100 - 0.0955 * m.eye_size, 0.034)
    # The fold follows the upper lid; skin hangs over it a little on the outside.
    fold = upper + 0.0215 + 0.004 * t
    if m.eye_open < 0.6:
        # A lid that closes leaves its fold behind.
        fold += m.eye_size * (0.6 - m.eye_open) * 0.026 * max(1.0 - t * t, 0.0)
    span = smooth_step(1.25, 0.75, abs(t))
    f = (y - fold) / 0.0085
    d += m.lid_fold * 0.0085 * span / (1.0 + f * f * f * f)
    d -= m.lid_fold * 0.006 * span * bump(y, 0.0, fold + 0.022, 0.0, 0.022, 1.0)
    b = (y - lower + 0.034 + 0.010 * t) / 0.014
    d += (0.0035 + 0.004 * m.folds) * smooth_step(1.2, 0.5, abs(t)) / (1.0 + b * b * b * b)
    d -= 0.0030 * span * bump(y, 0.0, upper + 0.004, 0.0, 0.007, 1.0)
    d -= 0.0028 * span * bump(y, 0.0, lower - 0.005, 0.0, 0.008, 1.0)
    slit = max(y - upper, lower - y)
    return carve(d, max(max(slit, radius - 0.20), -ez), 0.006)


@lean
def ear_distance(m, ax, y, z):
    """Ear: a tilted leaf with a rolled rim, an inner ridge, a hollow and a lobe."""
    # Local frame: u to the back of the head, v up, w out of the ear's face.
    size = 0.90 * m.ear_size
    px, py, pz = ax - 0.392 * m.skull_width, y + 0.085, z + 0.035
    py, pz = 0.978 * py + 0.208 * pz, -0.208 * py + 0.978 * pz
    u = -0.927 * pz + 0.375 * px
    w = 0.927 * px + 0.375 * pz
    u, v, w = u / size - 0.050, py / size, w / size - 0.012
    narrow = 0.094 + 0.028 * min(max(v / 0.18, -1.0), 1.0)
    r = sqrt((u / narrow) ** 2 + (v / 0.180) ** 2)
    leaf = (r - 1.0) * 0.100
    cup = w - 2.2 * u * u
    d = max(leaf, abs(cup) - 0.013)
    d = union(d, ellipsoid(u + 0.030, v + 0.020, w + 0.030, 0.055, 0.075, 0.040), 0.03)
    rim_out = leaf + 0.016
    rim = sqrt(rim_out * rim_out + (cup - 0.020) ** 2) - 0.0175 * (1.0 - 0.3 * smooth_step(
        -0.02, -0.15, v))
    d = union(d, rim, 0.010)
    d = union(d, ellipsoid(u + 0.026, v + 0.160, w, 0.044, 0.044, 0.020), 0.030)
    ridge_r = (sqrt((u / (0.58 * narrow)) ** 2 + ((v - 0.012) / 0.108) ** 2) - 1.0) * 0.058
    ridge = sqrt(ridge_r * ridge_r + (cup - 0.012) ** 2) - 0.0150
    d = union(d, ridge + 0.02 * smooth_step(0.0, -0.03, u), 0.014)
    d = carve(d, ellipsoid(u + 0.020, v + 0.022, w - 0.030, 0.038, 0.062, 0.036), 0.016)
    d = union(d, ellipsoid(u + 0.070, v + 0.030, w - 0.004, 0.018, 0.032, 0.022), 0.018)
    return d * size


@lean
def _torso(m, x, ax, y, z):
    """Neck, its muscles, collar bones and shoulders, cut like a bust."""
    d = capsule(x, y, z, 0.0, -0.30, -0.130, 0.0, -1.10, -0.190, 0.262 * m.neck_width,
                 0.292 * m.neck_width)
    cord = capsule(ax, y, z, 0.295 * m.neck_width, -0.34, -0.120, 0.055, -0.985, 0.080, 0.050,
                    0.042)
    d = union(d, cord, 0.110)
    d = union(d, ellipsoid(x, y + 0.640, z - 0.075, 0.045, 0.085, 0.050), 0.110)
    slope = capsule(ax, y, z, 0.10, -0.60, -0.290, 0.78, -1.06, -0.215, 0.150, 0.165)
    d = union(d, slope, 0.17)
    chest = ellipsoid(x, y + 1.26, z + 0.125, 0.95, 0.40, 0.330)
    return union(d, chest, 0.12)


@lean
def face_distance(m, x, ax, y, z, bone):
    """Everything of the face but ears and neck."""
    drop, wide = m.chin_drop, m.face_width
    d = bone
    jaw = capsule(ax, y, z, 0.248 * m.jaw_width, -0.345 - 0.5 * drop, 0.005, 0.052 * m.chin_width,
                   -0.560 - drop, 0.415 + m.chin_forward, 0.072, 0.064)
    d = union(d, jaw, 0.17)
    chin = ellipsoid(ax, y + 0.562 + drop, z - 0.458 - m.chin_forward, 0.080 * m.chin_width,
                      0.084, 0.095)
    d = union(d, chin, 0.110)
    cheek = capsule(ax, y, z, 0.195 * wide, -0.130, 0.395, 0.335 * wide, -0.050, 0.150,
                     0.046 * m.cheekbone, 0.034 * m.cheekbone)
    d = union(d, cheek, 0.150)
    side = ellipsoid(ax - 0.185 * wide * m.jaw_width, y + 0.285, z - 0.185, 0.125, 0.17, 0.19)
    d = union(d, side, 0.14)
    d = union(d, ellipsoid(ax, y + 0.385 + 0.4 * drop, z - 0.390, 0.165, 0.165, 0.135), 0.120)
    if z < 0.04:
        return d
    brow = capsule(ax, y, z, 0.040, 0.088, 0.470, 0.250, 0.100, 0.385, 0.040, 0.038)
    d = union(d, brow - 0.012 * (m.brow_ridge - 1.0), 0.080)
    d = _eyes(m, ax, y, z, d)
    d = _nose(m, ax, y, z, d)
    d = _lips(m, ax, y, z, d)
    hollow = m.cheek_hollow * bump(ax, y, 0.285, -0.290, 0.130, 0.190)
    d += 0.030 * hollow * smooth_step(0.04, 0.16, z)
    d -= 0.012 * bump(ax, y, 0.180, -0.200, 0.130, 0.120)
    if m.folds > 0.0:
        line = 0.088 + 0.33 * max(-0.205 - y, 0.0)
        f = (ax - line) / 0.016
        d += 0.010 * m.folds * bump(y, 0.0, -0.290, 0.0, 0.115, 1.0) / (1.0 + f * f * f * f)
        wave = y - 0.02 * noise(6.0 * ax, 3.0, 1.0)
        row = (wave - 0.20) / 0.055
        near = row - np.rint(row)
        if 0.15 < wave < 0.36:
            d += 0.0035 * m.folds * smooth_step(0.28, 0.10, ax) / (1.0 + 60.0 * near * near)
        d += 0.006 * m.folds * bump(ax, y, 0.024, 0.105, 0.012, 0.045)
    return d


@lean
def _cloth(m, x, ax, y, z, torso):
    """A shirt over the shoulders with a rolled neckline."""
    edge = y + 0.845 + 0.30 * max(z + 0.10, -0.22)
    d = max(torso - 0.022, edge)
    roll = sqrt((torso - 0.018) ** 2 + edge * edge) - 0.020
    d = union(d, roll, 0.020)
    return d + (0.010 * noise(5.0 * x, 3.0 * y, 4.0 * z) if abs(d) < 0.1 else 0.0)


@lean_kernel
def surfaces(m, x, y, z):
    """Signed distances to skin, hair, cloth and eyeballs at a world point.

    Parameters
    ----------
    m : The `HeadModel`.
    x, y, z : World coordinates.

    Returns
    -------
    skin, hair, cloth, eye : World units, negative inside.
    """
    ax = sqrt(x * x + 1e-6)
    bone = bone_distance(m, x, ax, y, z)
    skin = face_distance(m, x, ax, y, z, bone)
    beard = 10.0
    if m.beard_full > 0.0:
        beard = beard_distance(m, x, ax, y, z, skin, mouth_lines(m, 0.0)[1])
    away = sqrt((ax - 0.44) ** 2 + (y + 0.09) ** 2 + (z + 0.07) ** 2)
    if away < 0.46:
        skin = union(skin, ear_distance(m, ax, y, z), 0.030)
    else:
        skin = min(skin, ellipsoid(ax - 0.44, y + 0.09, z + 0.07, 0.13, 0.24, 0.18))
    hair = min(hair_distance(m, x, ax, y, z, bone), beard)
    cloth = 10.0
    if y < -0.25:
        torso = _torso(m, x, ax, y, z)
        skin = union(skin, torso, 0.075)
        side = sqrt(x * x + 0.3 * z * z) - 0.92
        cut = max(-0.985 - y, side)
        skin = max(skin, cut + 0.05)
        cloth = carve(_cloth(m, x, ax, y, z, torso), -carve(-0.985 - y, -side, 0.10), 0.03)
    ex, ez = ax - 0.184 - m.eye_space, z - 0.385
    eye = sqrt(ex * ex + y * y + ez * ez) - 0.0955 * m.eye_size
    # The pink corner beside the nose fills the gap that the ball leaves.
    corner = ellipsoid(ex + 0.074 * m.eye_size, y + 0.006, ez - 0.052, 0.022, 0.016, 0.022)
    eye = union(eye, corner, 0.010)
    return skin, hair, cloth, eye


@lean
def scene(m, x, y, z):
    """Signed distance to the nearest of all surfaces, and of what is worn."""
    skin, hair, cloth, eye = surfaces(m, x, y, z)
    nearest = min(min(skin, hair), min(cloth, eye))
    return min(nearest, worn_distance(m, x, y, z)) if m.spectacles > 0.0 else nearest
