"""Plain NumPy twin of the modelled head's signed distances, for arrays of points."""

import numpy as np

from .head_hair import beard, hair
from .solids import bump, capsule, carve, ellipsoid, noise, smooth, union


def lid_lines(m, ax):
    t = (ax - 0.184 - m.eye_space) / (0.086 * m.eye_size)
    s = np.maximum(1.0 - t * t, 0.0)
    beyond = 0.06 * np.maximum(np.abs(t) - 1.0, 0.0)
    level = 0.5 * (t + 1.0) * m.eye_tilt - 0.005
    upper = level + m.eye_size * m.eye_open * 0.0325 * s**0.75 * (1.0 - 0.15 * t) - beyond
    lower = level - m.eye_size * 0.0265 * s**0.95 * (1.0 + 0.22 * t) + beyond
    return upper, lower, t


def mouth_lines(m, ax):
    t = ax / (0.140 * m.mouth_width)
    s = np.maximum(1.0 - t * t, 0.0)
    base = -0.400 - 0.45 * m.chin_drop
    gap = base + m.smile * t * t + 0.006 * (1.0 - t) * t * t - 0.006 * bump(t, 0, 0, 0, 0.5, 1)
    bow = 0.17 * bump(t, 0, 0.24, 0, 0.42, 1) - 0.14 * bump(t, 0, 0, 0, 0.26, 1)
    upper = gap + m.lip_upper * 0.044 * (s**1.05 * (0.90 - 0.10 * t) + bow)
    lower = gap - m.lip_lower * 0.056 * s**0.72 * (1.0 - 0.12 * t)
    return upper, gap, lower, t


def bone(m, x, y, z):
    d = ellipsoid(x, y - 0.175, z + 0.045, 0.415 * m.skull_width, 0.485, 0.545)
    return union(d, ellipsoid(x, y + 0.135, z - 0.125, 0.338 * m.face_width, 0.44, 0.375), 0.16)


def nose(m, ax, y, z, d):
    low, out, wide = -m.nose_length, m.nose_out, m.nose_width
    bridge = capsule(ax, y, z, (0, 0.085, 0.478), (0, -0.180 + low, 0.612 + out), 0.031 * wide,
                     0.036 * wide)
    body = capsule(ax, y, z, (0, 0.040, 0.430), (0, -0.175 + low, 0.520 + 0.5 * out),
                   0.040 * wide, 0.056 * wide)
    d = union(d, body, 0.080)
    d = union(d, bridge - 0.018 * m.nose_hump * bump(ax, y, 0, -0.03, 0.08, 0.10), 0.100)
    d = union(d, ellipsoid(ax, y + 0.200 - low, z - 0.622 - out, 0.047 * wide, 0.042, 0.052), 0.06)
    d = union(d, ellipsoid(ax - 0.060 * wide, y + 0.218 - low, z - 0.560 - 0.4 * out,
                           0.029 * wide, 0.034, 0.054), 0.034)
    d = union(d, capsule(ax, y, z, (0, -0.236 + low, 0.618 + out), (0, -0.258 + low, 0.540),
                         0.019, 0.022), 0.030)
    hx, hy, hz = ax - 0.035 * wide, y + 0.250 - low, z - 0.586 - 0.7 * out
    return carve(d, ellipsoid(hx - 0.30 * hz, hy, hz, 0.0185 * wide, 0.026, 0.036), 0.014)


def lips(m, ax, y, z, d):
    upper, gap, lower, t = mouth_lines(m, ax)
    fade = smooth(1.02, 0.55, t)
    u = (y - 0.5 * (gap + upper)) / (0.5 * (upper - gap + 1e-3) + 0.004)
    v = (y - 0.5 * (gap + lower)) / (0.5 * (gap - lower) + 0.006)
    groove = (y - gap) / 0.012
    shape = -np.where(np.abs(u) < 1.0, 0.016 * m.lip_upper**0.5 * fade * (1 - u * u)
                      * (1 - 0.25 * u), 0.0)
    shape -= np.where(np.abs(v) < 1.0, 0.022 * m.lip_lower**0.5 * fade * (1 - v * v)
                      * (1 + 0.15 * v), 0.0)
    shape += 0.017 * smooth(1.12, 0.80, t) / (1.0 + groove**4)
    d = d + np.where(t < 1.25, shape, 0.0)
    corner = 0.140 * m.mouth_width
    d = d + 0.007 * bump(ax, y, corner + 0.010, gap, 0.050, 0.045)
    d = d - 0.006 * bump(ax, y, corner + 0.065, gap - 0.005, 0.080, 0.100)
    d = d + 0.008 * bump(ax, y, 0.0, upper + 0.030, 0.030, 0.065)
    d = d - 0.003 * bump(ax, y, 0.034, upper + 0.030, 0.034, 0.065)
    return d + 0.020 * bump(ax, y, 0.0, lower - 0.030, 0.160, 0.065)


def eyes(m, ax, y, z, d):
    cx = 0.184 + m.eye_space
    d = d + 0.038 * bump(ax, y, cx - 0.060, 0.004, 0.125, 0.110)
    d = d + 0.020 * bump(ax, y, cx + 0.02, 0.040, 0.17, 0.075)
    ez = z - 0.385
    radius = np.sqrt((ax - cx) ** 2 + y * y + ez * ez)
    d = union(d, capsule(ax, y, z, (cx + 0.100, 0.080, 0.350), (cx + 0.095, -0.060, 0.345), 0.032,
                         0.034), 0.090)
    outside = (ez < -0.11) | (radius > 0.28)
    upper, lower, t = lid_lines(m, ax)
    e = union(d, radius - 0.0100 - 0.0955 * m.eye_size, 0.034)
    fold = upper + 0.0215 + 0.004 * t
    fold = fold + 0.026 * m.eye_size * max(0.6 - m.eye_open, 0.0) * np.maximum(1.0 - t * t, 0.0)
    span = smooth(1.25, 0.75, np.abs(t))
    e = e + m.lid_fold * 0.0085 * span / (1.0 + ((y - fold) / 0.0085) ** 4)
    e = e - m.lid_fold * 0.006 * span * bump(y, 0.0, fold + 0.022, 0.0, 0.022, 1.0)
    bag = (y - lower + 0.034 + 0.010 * t) / 0.014
    e = e + (0.0035 + 0.004 * m.folds) * smooth(1.2, 0.5, np.abs(t)) / (1.0 + bag**4)
    e = e - 0.0030 * span * bump(y, 0.0, upper + 0.004, 0.0, 0.007, 1.0)
    e = e - 0.0028 * span * bump(y, 0.0, lower - 0.005, 0.0, 0.008, 1.0)
    slit = np.maximum(np.maximum(np.maximum(y - upper, lower - y), radius - 0.20), -ez)
    return np.where(outside, d, carve(e, slit, 0.006))


def ear(m, ax, y, z):
    size = 0.90 * m.ear_size
    px, py, pz = ax - 0.392 * m.skull_width, y + 0.085, z + 0.035
    py, pz = 0.978 * py + 0.208 * pz, -0.208 * py + 0.978 * pz
    u, w = -0.927 * pz + 0.375 * px, 0.927 * px + 0.375 * pz
    u, v, w = u / size - 0.050, py / size, w / size - 0.012
    narrow = 0.094 + 0.028 * np.clip(v / 0.18, -1.0, 1.0)
    leaf = (np.hypot(u / narrow, v / 0.180) - 1.0) * 0.100
    cup = w - 2.2 * u * u
    d = np.maximum(leaf, np.abs(cup) - 0.013)
    d = union(d, ellipsoid(u + 0.030, v + 0.020, w + 0.030, 0.055, 0.075, 0.040), 0.03)
    rim = np.hypot(leaf + 0.016, cup - 0.020) - 0.0175 * (1 - 0.3 * smooth(-0.02, -0.15, v))
    d = union(d, rim, 0.010)
    d = union(d, ellipsoid(u + 0.026, v + 0.160, w, 0.044, 0.044, 0.020), 0.030)
    ridge = (np.hypot(u / (0.58 * narrow), (v - 0.012) / 0.108) - 1.0) * 0.058
    ridge = np.hypot(ridge, cup - 0.012) - 0.0150
    d = union(d, ridge + 0.02 * smooth(0.0, -0.03, u), 0.014)
    d = carve(d, ellipsoid(u + 0.020, v + 0.022, w - 0.030, 0.038, 0.062, 0.036), 0.016)
    return union(d, ellipsoid(u + 0.070, v + 0.030, w - 0.004, 0.018, 0.032, 0.022), 0.018) * size


def torso(m, x, ax, y, z):
    w = m.neck_width
    d = capsule(x, y, z, (0, -0.30, -0.130), (0, -1.10, -0.190), 0.262 * w, 0.292 * w)
    d = union(d, capsule(ax, y, z, (0.295 * w, -0.34, -0.120), (0.055, -0.985, 0.080), 0.050,
                         0.042), 0.110)
    d = union(d, ellipsoid(x, y + 0.640, z - 0.075, 0.045, 0.085, 0.050), 0.110)
    d = union(d, capsule(ax, y, z, (0.10, -0.60, -0.290), (0.78, -1.06, -0.215), 0.150, 0.165),
              0.17)
    return union(d, ellipsoid(x, y + 1.26, z + 0.125, 0.95, 0.40, 0.330), 0.12)


def face(m, ax, y, z, d):
    drop, wide = m.chin_drop, m.face_width
    d = union(d, capsule(ax, y, z, (0.248 * m.jaw_width, -0.345 - 0.5 * drop, 0.005),
                         (0.052 * m.chin_width, -0.560 - drop, 0.415 + m.chin_forward), 0.072,
                         0.064), 0.17)
    d = union(d, ellipsoid(ax, y + 0.562 + drop, z - 0.458 - m.chin_forward, 0.080 * m.chin_width,
                           0.084, 0.095), 0.110)
    d = union(d, capsule(ax, y, z, (0.195 * wide, -0.130, 0.395), (0.335 * wide, -0.050, 0.150),
                         0.046 * m.cheekbone, 0.034 * m.cheekbone), 0.150)
    d = union(d, ellipsoid(ax - 0.185 * wide * m.jaw_width, y + 0.285, z - 0.185, 0.125, 0.17,
                           0.19), 0.14)
    back = union(d, ellipsoid(ax, y + 0.385 + 0.4 * drop, z - 0.390, 0.165, 0.165, 0.135), 0.120)
    brow = capsule(ax, y, z, (0.040, 0.088, 0.470), (0.250, 0.100, 0.385), 0.040, 0.038)
    d = union(back, brow - 0.012 * (m.brow_ridge - 1.0), 0.080)
    d = lips(m, ax, y, z, nose(m, ax, y, z, eyes(m, ax, y, z, d)))
    d = d + 0.030 * m.cheek_hollow * bump(ax, y, 0.285, -0.290, 0.130, 0.190) * smooth(0.04, 0.16,
                                                                                       z)
    d = d - 0.012 * bump(ax, y, 0.180, -0.200, 0.130, 0.120)
    if m.folds > 0.0:
        f = (ax - 0.088 - 0.33 * np.maximum(-0.205 - y, 0.0)) / 0.016
        d = d + 0.010 * m.folds * bump(y, 0.0, -0.290, 0.0, 0.115, 1.0) / (1.0 + f**4)
        wave = y - 0.02 * noise(6.0 * ax, 3.0, 1.0)
        row = (wave - 0.20) / 0.055
        near = row - np.rint(row)
        d = d + np.where((wave > 0.15) & (wave < 0.36), 0.0035 * m.folds * smooth(0.28, 0.10, ax)
                         / (1.0 + 60.0 * near * near), 0.0)
        d = d + 0.006 * m.folds * bump(ax, y, 0.024, 0.105, 0.012, 0.045)
    return np.where(z < 0.04, back, d)


def surfaces(m, points):
    """Signed distances [N, 4] of points [N, 3] to skin, hair, cloth and eyeballs."""
    x, y, z = np.asarray(points, np.float64).T
    ax = np.sqrt(x * x + 1e-6)
    d = bone(m, x, y, z)
    skin = face(m, ax, y, z, d)
    covered = hair(m, x, ax, y, z, d)
    if m.beard_full > 0.0:
        covered = np.minimum(covered, beard(m, x, ax, y, z, skin, mouth_lines(m, 0.0)[1]))
    away = np.sqrt((ax - 0.44) ** 2 + (y + 0.09) ** 2 + (z + 0.07) ** 2)
    skin = np.where(away < 0.46, union(skin, ear(m, ax, y, z), 0.030),
                    np.minimum(skin, ellipsoid(ax - 0.44, y + 0.09, z + 0.07, 0.13, 0.24, 0.18)))
    body = torso(m, x, ax, y, z)
    side = np.sqrt(x * x + 0.3 * z * z) - 0.92
    low = y < -0.25
    cut = np.maximum(-0.985 - y, side)
    skin = np.where(low, np.maximum(union(skin, body, 0.075), cut + 0.05), skin)
    edge = y + 0.845 + 0.30 * np.maximum(z + 0.10, -0.22)
    shirt = union(np.maximum(body - 0.022, edge), np.hypot(body - 0.018, edge) - 0.020, 0.020)
    shirt = np.where(np.abs(shirt) < 0.1, shirt + 0.010 * noise(5 * x, 3 * y, 4 * z), shirt)
    cloth = np.where(low, carve(shirt, -carve(-0.985 - y, -side, 0.10), 0.03), 10.0)
    ex, ez = ax - 0.184 - m.eye_space, z - 0.385
    eye = np.sqrt(ex * ex + y * y + ez * ez) - 0.0955 * m.eye_size
    corner = ellipsoid(ex + 0.074 * m.eye_size, y + 0.006, ez - 0.052, 0.022, 0.016, 0.022)
    return np.stack([skin, covered, cloth, union(eye, corner, 0.010)], axis=-1)
