"""Building blocks of modelled heads: signed distances of simple solids, smooth joins, and noise.

A signed distance is negative inside. Joins are quadratic (the blend has compact support ``k``), so
that parts far from a point can be left out without changing the result.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from lfportrait.simd.decorators import lean

__all__ = ["bump", "capsule", "carve", "ellipsoid", "fractal", "noise", "smooth_step",
           "uniform", "union"]


@lean
def bump(x, y, cx, cy, rx, ry):
    """Smooth bump of height 1 at (cx, cy), zero outside the ellipse of radii (rx, ry)."""
    u, v = (x - cx) / rx, (y - cy) / ry
    s = 1.0 - u * u - v * v
    return s * s if s > 0.0 else 0.0


@lean
def smooth_step(low, high, value):
    """Hermite step from 0 at ``low`` to 1 at ``high``."""
    t = min(max((value - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@lean
def union(a, b, k):
    """Smooth minimum (quadratic) with blending width ``k``."""
    h = max(k - abs(a - b), 0.0)
    return min(a, b) - h * h / (4.0 * k)


@lean
def carve(a, b, k):
    """``a`` without ``b``, with an edge rounded over ``k``."""
    return -union(-a, b, k)


@lean
def ellipsoid(x, y, z, rx, ry, rz):
    """Approximate distance to an ellipsoid at the origin."""
    u, v, w = x / rx, y / ry, z / rz
    outer = sqrt(u * u + v * v + w * w)
    u, v, w = u / rx, v / ry, w / rz
    inner = sqrt(u * u + v * v + w * w)
    return outer * (outer - 1.0) / inner if inner > 1e-6 else -min(rx, ry, rz)


@lean
def capsule(x, y, z, ax, ay, az, bx, by, bz, ra, rb):
    """Distance to a capsule from a to b whose radius goes linearly from ``ra`` to ``rb``."""
    px, py, pz = x - ax, y - ay, z - az
    dx, dy, dz = bx - ax, by - ay, bz - az
    t = (px * dx + py * dy + pz * dz) / (dx * dx + dy * dy + dz * dz)
    t = min(max(t, 0.0), 1.0)
    px, py, pz = px - t * dx, py - t * dy, pz - t * dz
    return sqrt(px * px + py * py + pz * pz) - (ra + t * (rb - ra))


@lean
def uniform(i, j, k):
    """Uniform number in [0, 1) from three integers (wrapping 32-bit mixing)."""
    # Numba widens products of 32-bit integers, so each is cut back to 32 bits.
    h = np.uint32(np.uint32(i) * np.uint32(0x8DA6B343)) ^ np.uint32(
        np.uint32(j) * np.uint32(0xD8163841)) ^ np.uint32(np.uint32(k) * np.uint32(0xCB1AB31F))
    h = np.uint32(np.uint32(h ^ (h >> np.uint32(15))) * np.uint32(0x2C1B3C6D))
    h = np.uint32(np.uint32(h ^ (h >> np.uint32(12))) * np.uint32(0x297A2D39))
    h = np.uint32(h ^ (h >> np.uint32(15)))
    return np.float64(h) / 4294967296.0


@lean
def noise(x, y, z):
    """Value noise in [-1, 1], smooth, one cell per unit."""
    fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
    i, j, k = int(fx), int(fy), int(fz)
    u, v, w = x - fx, y - fy, z - fz
    u, v, w = u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v), w * w * (3.0 - 2.0 * w)
    a = uniform(i, j, k) * (1.0 - u) + uniform(i + 1, j, k) * u
    b = uniform(i, j + 1, k) * (1.0 - u) + uniform(i + 1, j + 1, k) * u
    c = uniform(i, j, k + 1) * (1.0 - u) + uniform(i + 1, j, k + 1) * u
    d = uniform(i, j + 1, k + 1) * (1.0 - u) + uniform(i + 1, j + 1, k + 1) * u
    return 2.0 * ((a * (1.0 - v) + b * v) * (1.0 - w) + (c * (1.0 - v) + d * v) * w) - 1.0


@lean
def fractal(x, y, z):
    """Three octaves of `noise`, about [-1, 1]."""
    return 0.57 * noise(x, y, z) + 0.29 * noise(2.1 * x + 5.2, 2.1 * y + 1.3, 2.1 * z + 8.1) + (
        0.14 * noise(4.3 * x + 1.7, 4.3 * y + 9.2, 4.3 * z + 2.8))
