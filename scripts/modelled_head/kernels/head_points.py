"""Points on the modelled head: its front seen from +z, and the outline of its face."""

from __future__ import annotations

from math import sqrt

import numpy as np

from lfportrait.simd.decorators import kernel

from .head import bone_distance, face_distance, surfaces

__all__ = ["drop", "silhouette"]


@kernel
def drop(m, x, y):
    """Height z of the foremost skin or eyeball at (x, y), for arrays [N]; NaN where none is."""
    out = np.full(x.shape[0], np.nan)
    for i in range(x.shape[0]):
        z = 0.95
        for _ in range(400):
            skin, _, _, eye = surfaces(m, x[i], y[i], z)
            d = min(skin, eye)
            out[i] = z
            if abs(d) < 1e-6:
                break
            # Short steps: the distance overestimates near folds.
            z -= 0.4 * d
            if z < -1.0:
                out[i] = np.nan
                break
    return out


@kernel
def silhouette(m, angles, cx, cy):
    """Outline of the face without ears, hair and neck, seen from the front.

    For each direction ``angles`` [N] (radians from +x towards +y) about (cx, cy): the point [N, 3]
    of the face furthest from the middle, among those in front of the ears.
    """
    out = np.zeros((angles.shape[0], 3))
    for i in range(angles.shape[0]):
        c, s = np.cos(angles[i]), np.sin(angles[i])
        low, high, depth = 0.05, 0.9, 0.0
        for _ in range(24):
            r = 0.5 * (low + high)
            x, y = cx + r * c, cy + r * s
            ax = sqrt(x * x + 1e-6)
            best, where = 1e9, 0.0
            for k in range(60):
                z = 0.12 + 0.008 * k
                d = face_distance(m, x, ax, y, z, bone_distance(m, x, ax, y, z))
                if d < best:
                    best, where = d, z
            if best < 0.0:
                low, depth = r, where
            else:
                high = r
        out[i, 0], out[i, 1], out[i, 2] = cx + low * c, cy + low * s, depth
    return out
