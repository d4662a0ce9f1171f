"""Plain NumPy twin of the modelled head's hair, beard and spectacles, for arrays of points."""

import numpy as np

from .solids import bump, capsule, carve, ellipsoid, noise, smooth, uniform, union


def hair_coordinates(m, x, y, z):
    py, pz = y - 0.10, z + 0.02
    ay, az = m.hair_pole_y - 0.10, m.hair_pole_z + 0.02
    if m.hair_length > 0.0:
        az = az * smooth(-0.40, 0.45, y)
    size = np.hypot(ay, az)
    ay, az = ay / size, az / size
    along, across = py * ay + pz * az, py * az - pz * ay
    theta = np.arctan2(np.sqrt(x * x + across * across) + 1e-9, along)
    phi = turn = np.arctan2(x, -across)
    wave = 0.020 * noise(7 * x, 7 * y, 7 * z)
    if m.hair_wave > 0.0:
        swing = np.sin(15.0 * y + 1.6 * noise(2.0 * turn, 1.2 * y, 3.0))
        wave = wave + m.hair_wave * swing * smooth(0.45, -0.15, y)
    if m.hair_length > 0.0:
        edge = m.hair_front + 0.70 * np.clip(y, 0.0, 0.3) - 0.045
        beside = 0.29 + 2.7 * np.abs(x) - 1.6 * np.minimum(z, edge)
        near = smooth(-0.25, 0.05, z) * smooth(0.25, -0.40, y)
        phi = phi + near * (np.where(x > 0.0, beside, -beside) - phi)
    phi = phi + m.hair_twist * theta + wave
    if m.beard_full > 0.0:
        hangs = (y < -0.10) & (z > -0.06)
        turn = np.arctan2(x, z + 0.10) + 0.05 * noise(6.0 * x, 9.0 * y, 6.0 * z)
        phi, theta = np.where(hangs, turn, phi), np.where(hangs, 1.2 - 2.0 * y, theta)
        lip = hangs & (y > -0.41 - 0.25 * np.abs(x)) & (np.abs(x) < 0.19)
        phi = np.where(lip, 2.5 * y + 1.1 * np.abs(x), phi)
        theta = np.where(lip, 5.0 * x, theta)
    if m.hair_knot > 0.0:
        ky, kz = y - m.hair_pole_y, z - m.hair_pole_z
        turn = np.arctan2(x, 0.6 * ky - 0.8 * kz)
        height = (0.8 * ky + 0.6 * kz) / m.hair_knot
        inside = x * x + ky * ky + kz * kz < (1.18 * m.hair_knot) ** 2
        wound = 0.5 * turn + 1.9 * height + 0.05 * noise(3.0 * turn, 4.0 * height, 1.0)
        phi = np.where(inside, wound, phi)
        theta = np.where(inside, 0.6 + 0.25 * np.cos(turn), theta)
    return phi, theta


def hair_cover(m, ax, y, z, phi):
    front = 0.62 * (y - 0.415 - m.hairline) - 0.80 * (z - 0.455)
    front = front - 0.55 * np.maximum(0.20 - ax, 0.0) ** 2
    front = front - m.hair_recede * smooth(0.12, 0.42, y) * (0.55 + 0.45 * smooth(0.04, 0.22, ax))
    front = union(front, 0.62 * (y - 0.03) - 0.80 * (z - 0.145), 0.10)
    ring = 0.13 * (np.hypot((z + 0.075) / 0.120, (y + 0.105) / 0.205) - 1.0)
    ring = np.maximum(ring, 0.10 * (z - 0.02))
    bottom = np.where(z > -0.06, y + 0.14, 0.9 * (y + 0.25) - 0.25 * (z + 0.35))
    return np.minimum(np.minimum(front, ring), bottom) + 0.010 * noise(12.0 * phi, 3.0 * y, 0.0)


def curls(x, y, z):
    p = np.stack([15.0 * x + 0.3 * y, 15.0 * y - 0.3 * z, 15.0 * z + 0.3 * x], axis=-1)
    cell = np.floor(p).astype(np.int64)
    nearest = np.full(x.shape, 9.0)
    for step in np.ndindex(3, 3, 3):
        i, j, k = np.moveaxis(cell + np.array(step) - 1, -1, 0)
        ball = np.stack([i + uniform(i, j, 3 * k), j + uniform(i, j, 3 * k + 1),
                         k + uniform(i, j, 3 * k + 2)], axis=-1)
        nearest = np.minimum(nearest, ((p - ball) ** 2).sum(axis=-1))
    u, v, w = np.moveaxis(p, -1, 0)
    return 0.66 * np.maximum(1.0 - nearest, 0.0) + 0.20 * np.abs(
        noise(2.3 * u, 2.3 * v, 2.3 * w)) + 0.14 * np.abs(noise(5.7 * v, 5.7 * w, 5.7 * u))


def relief(phi, theta):
    return 0.42 * noise(phi * 9.0, theta * 1.3, 2.0) + 0.36 * noise(
        phi * 23.0, theta * 2.0, 5.0) + 0.22 * noise(phi * 61.0, theta * 3.0, 7.0)


def scalp(m, x, ax, y, z, d, phi, theta):
    knot = np.full(x.shape, 10.0)
    if m.hair_knot > 0.0:
        knot = np.sqrt(x**2 + (y - m.hair_pole_y) ** 2 + (z - m.hair_pole_z) ** 2) - m.hair_knot
        wound = 0.016 * noise(phi * 5.0, theta, 4.0) + 0.006 * noise(phi * 14.0, theta, 9.0)
        knot = np.where(np.abs(knot) < 0.06, knot + wound, knot)
    deep = max(m.hair_curl + max(m.hair_top, m.hair_side) - 0.16, 0.0)
    far = np.minimum(np.where(d > 0.0, np.maximum(d - 0.16 - deep, 0.05), 0.05), knot)
    outside = (d > 0.30 + deep) | (d < -0.12)
    high = smooth(-0.05, 0.45, y)
    thick = m.hair_side + (m.hair_top - m.hair_side) * high
    thick = thick + m.hair_quiff * bump(x, z, 0.03, 0.30, 0.42, 0.34) * high
    cover = hair_cover(m, ax, y, z, phi)
    if m.hair_curl > 0.0:
        layer = carve(d - thick, cover, 0.14)
        height = np.where(layer < 0.10 + m.hair_curl, curls(x, y, z), 1.0)
        return np.where(outside, far, layer - m.hair_curl * height)
    grown = np.clip(cover / 0.25, -0.5, 1.0)
    rise = np.where(grown > 0.0, grown * (2.0 - grown), 2.0 * grown)
    layer = d - thick * rise - 0.002
    high_relief = 0.020 * m.hair_relief * relief(phi, theta) * smooth(0.0, 0.5, theta) * (
        0.25 + 0.75 * np.maximum(grown, 0.0))
    layer = np.where(layer < 0.07, layer - high_relief, layer)
    layer = layer + m.hair_parting * bump(x, z, 0.0, 0.14, 0.040, 0.40) * high
    if m.hair_fringe > 0.0:
        front = smooth(0.02, 0.30, z)
        sheet = d - m.hair_fringe * front + 0.03 * (1.0 - front)
        near = np.abs(sheet) < 0.09
        sheet = np.where(near, sheet - 0.014 * m.hair_relief * relief(phi, theta), sheet)
        tips = 0.022 * noise(phi * 11.0, 1.0, 3.0) + 0.016 * noise(phi * 31.0, 2.0, 6.0)
        end = 0.160 + m.brow_height - 0.25 * ax * ax + np.where(near, tips, 0.0)
        layer = union(layer, carve(sheet, y - end, 0.025), 0.04)
    return np.where(outside, far, union(layer, knot, 0.05))


def hanging(m, x, ax, y, z, phi, theta):
    low = smooth(0.10, -0.55, y)
    wide = (0.480 + 0.030 * low) * m.skull_width
    across, up, deep = x / wide, np.maximum(y - 0.02, 0.0) / 0.58, (z + 0.05) / (0.56 - 0.05 * low)
    outer = np.sqrt(across**2 + up**2 + deep**2)
    inner = np.sqrt((across / wide) ** 2 + (up / 0.58) ** 2 + (deep / (0.56 - 0.05 * low)) ** 2)
    column = outer * (outer - 1.0) / np.maximum(inner, 1e-6)
    front = m.hair_front + 0.70 * np.clip(y, 0.0, 0.3) - z
    corner = 0.08 - 0.17 * smooth(-0.58, -0.36, y)
    throat = np.maximum(-corner - z, ax - 0.325 * m.face_width) + (
        np.maximum(0.08 - np.abs(corner + z - 0.325 * m.face_width + ax), 0.0) ** 2 / 0.32)
    d = carve(column, union(front, throat, 0.06), 0.05)
    near = np.abs(d) < 0.12
    locks = 0.024 * m.hair_relief * relief(phi, theta)
    locks = locks + 0.22 * m.hair_wave * noise(phi * 4.0, 3.5 * y, 8.0)
    tips = 0.030 * noise(phi * 5.0, 1.0, 3.0) + 0.022 * noise(phi * 23.0, 2.0, 6.0)
    end = -m.hair_length + np.where(near, tips, 0.0)
    d = carve(np.where(near, d - locks, d), y - end, 0.04)
    return np.where(column > 0.30, column - 0.10, d)


def hair(m, x, ax, y, z, d):
    phi, theta = hair_coordinates(m, x, y, z)
    grown = scalp(m, x, ax, y, z, d, phi, theta)
    if m.hair_length > 0.0:
        grown = union(grown, hanging(m, x, ax, y, z, phi, theta), 0.06)
    return grown


def beard(m, x, ax, y, z, face, gap):
    reach = m.beard_full + m.beard_length + 0.10
    far = (face > reach + 0.15) | (y > 0.20) | (z < -0.25)
    top = -0.290 + 0.60 * np.maximum(ax - 0.15, 0.0) + 1.1 * np.maximum(0.19 - z, 0.0)
    top = top - 0.16 * smooth(0.20, 0.13, ax)
    cover = union(0.75 * (top - y), z - 0.045 + 0.25 * smooth(-0.30, -0.55, y), 0.04)
    lips = (np.hypot(ax / 0.105, (y - gap + 0.020) / 0.034) - 1.0) * 0.038
    cover = np.minimum(np.minimum(cover, 0.06 - y), lips)
    d = carve(face - m.beard_full * (0.30 + 0.70 * smooth(-0.10, -0.46, y)), cover, 0.09)
    hang = ellipsoid(x, y + 0.58 + m.chin_drop + 0.4 * m.beard_length, z - 0.36 - m.chin_forward,
                     0.215 * m.jaw_width, 0.16 + 0.7 * m.beard_length, 0.185)
    d = carve(union(d, hang, 0.10), lips, 0.03)
    turn = np.arctan2(x, z + 0.10) + 0.05 * noise(6.0 * x, 9.0 * y, 6.0 * z)
    locks = 0.012 * noise(turn * 13.0, 4.0 * y, 2.0) + 0.008 * noise(turn * 34.0, 7.0 * y, 5.0)
    locks = locks + 0.004 * noise(turn * 80.0, 10.0 * y, 7.0)
    locks = locks * (0.25 + 0.75 * smooth(0.0, 0.10, cover))
    d = np.where(np.abs(d) < 0.08, d - locks, d)
    lip = capsule(ax, y, z, (0.024, -0.334 - 0.8 * m.nose_length, 0.522),
                  (0.200, gap - 0.045, 0.478), 0.050, 0.032)
    across = y + 0.45 * ax
    strands = 0.007 * noise(35.0 * across, 5.0 * x, 1.0)
    strands = strands + 0.004 * noise(90.0 * across, 9.0 * x, 2.0)
    lip = np.where(np.abs(lip) < 0.05, lip - strands, lip)
    return np.where(far, np.maximum(face - reach, 0.05), union(d, lip, 0.012))


def worn(m, x, y, z):
    """The spectacles."""
    ax, middle = np.abs(x), 0.196 + m.eye_space
    u, v = np.abs(ax - middle) - 0.028, np.abs(y + 0.012) - 0.008
    ring = np.hypot(np.maximum(u, 0.0), np.maximum(v, 0.0)) + np.minimum(np.maximum(u, v), 0.0)
    d = np.sqrt((ring - 0.1) ** 2 + 0.85 * (z - 0.585 + 0.35 * ax * ax) ** 2)
    outer, side = middle + 0.128, 0.420 * m.skull_width
    hinge = 0.585 - 0.35 * outer * outer
    wire = ((0.0, 0.040, 0.598), (middle - 0.128, 0.022, 0.583)), (
        (outer, 0.030, hinge), (outer + 0.02, 0.033, hinge - 0.03)), (
        (outer + 0.02, 0.033, hinge - 0.03), (side, 0.075, -0.04)), (
        (side, 0.075, -0.04), (side - 0.01, -0.06, -0.16))
    for start, end in wire:
        d = np.minimum(d, capsule(ax, y, z, start, end, 0.0, 0.0))
    return d - m.spectacles
