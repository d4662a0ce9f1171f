"""Signed distance of what a modelled head wears: spectacles."""

from __future__ import annotations

from math import sqrt

from lfportrait.simd.decorators import lean_kernel

from .implicit import capsule

__all__ = ["worn_distance"]


@lean_kernel
def worn_distance(m, x, y, z):
    """Spectacles: two rings before the eyes, a bridge, and temples that bend behind the ears.

    World units; ``m.spectacles`` is the radius of the wire, and must not be 0.
    """
    ax = abs(x)
    middle = 0.196 + m.eye_space
    u, v = abs(ax - middle) - 0.128 + 0.100, abs(y + 0.012) - 0.108 + 0.100
    ring = sqrt(max(u, 0.0) ** 2 + max(v, 0.0) ** 2) + min(max(u, v), 0.0) - 0.100
    # The rims follow the face around.
    front = 0.585 - 0.35 * ax * ax
    d = sqrt(ring * ring + 0.85 * (z - front) ** 2)
    inner, outer = middle - 0.128, middle + 0.128
    d = min(d, capsule(ax, y, z, 0.0, 0.040, 0.598, inner, 0.022, 0.583, 0.0, 0.0))
    hinge = 0.585 - 0.35 * outer * outer
    side = 0.420 * m.skull_width
    d = min(d, capsule(ax, y, z, outer, 0.030, hinge, outer + 0.02, 0.033, hinge - 0.03, 0.0, 0.0))
    d = min(d, capsule(ax, y, z, outer + 0.02, 0.033, hinge - 0.03, side, 0.075, -0.04, 0.0, 0.0))
    d = min(d, capsule(ax, y, z, side, 0.075, -0.04, side - 0.01, -0.06, -0.16, 0.0, 0.0))
    return d - m.spectacles
