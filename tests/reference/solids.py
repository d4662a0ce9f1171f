"""Plain NumPy twins of the solids, joins and noise that modelled heads are built of."""

import numpy as np


def bump(x, y, cx, cy, rx, ry):
    s = 1.0 - ((x - cx) / rx) ** 2 - ((y - cy) / ry) ** 2
    return np.where(s > 0.0, s * s, 0.0)


def smooth(low, high, value):
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def union(a, b, k):
    h = np.maximum(k - np.abs(a - b), 0.0)
    return np.minimum(a, b) - h * h / (4.0 * k)


def carve(a, b, k):
    return -union(-a, b, k)


def ellipsoid(x, y, z, rx, ry, rz):
    p = np.stack(np.broadcast_arrays(x, y, z), axis=-1)
    r = np.array([rx, ry, rz])
    outer = np.linalg.norm(p / r, axis=-1)
    inner = np.linalg.norm(p / r**2, axis=-1)
    return np.where(inner > 1e-6, outer * (outer - 1.0) / np.maximum(inner, 1e-6), -r.min())


def capsule(x, y, z, a, b, ra, rb):
    p = np.stack(np.broadcast_arrays(x, y, z), axis=-1) - np.array(a)
    d = np.array(b) - np.array(a)
    t = np.clip(p @ d / (d @ d), 0.0, 1.0)
    return np.linalg.norm(p - t[..., None] * d, axis=-1) - (ra + t * (rb - ra))


def uniform(i, j, k):
    i, j, k = (np.asarray(v).astype(np.int64).astype(np.uint32) for v in (i, j, k))
    with np.errstate(over="ignore"):
        h = (i * np.uint32(0x8DA6B343)) ^ (j * np.uint32(0xD8163841)) ^ (
            k * np.uint32(0xCB1AB31F))
        h = (h ^ (h >> np.uint32(15))) * np.uint32(0x2C1B3C6D)
        h = (h ^ (h >> np.uint32(12))) * np.uint32(0x297A2D39)
        h = h ^ (h >> np.uint32(15))
    return h / 4294967296.0


def noise(x, y, z):
    p = np.stack(np.broadcast_arrays(*(np.asarray(v, float) for v in (x, y, z))), axis=-1)
    cell = np.floor(p)
    w = p - cell
    w = w * w * (3.0 - 2.0 * w)
    cell = cell.astype(np.int64)
    total = np.zeros(p.shape[:-1])
    for dx in (0, 1):
        for dy in (0, 1):
            for dz in (0, 1):
                weight = np.ones(p.shape[:-1])
                for axis, d in enumerate((dx, dy, dz)):
                    weight = weight * (w[..., axis] if d else 1.0 - w[..., axis])
                total += weight * uniform(cell[..., 0] + dx, cell[..., 1] + dy, cell[..., 2] + dz)
    return 2.0 * total - 1.0
