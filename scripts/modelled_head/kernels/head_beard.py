"""Signed distance of a full beard with its moustache."""

from __future__ import annotations

from math import atan2, sqrt

from lfportrait.simd.decorators import lean

from .implicit import capsule, carve, ellipsoid, noise, smooth_step, union

__all__ = ["beard_distance"]


@lean
def beard_distance(m, x, ax, y, z, face, gap):
    """A layer over cheeks and jaw, a mass under the chin, and a moustache.

    ``face`` is the distance to the face without ears and neck, ``gap`` the height of the line
    between the lips in the middle.
    """
    reach = m.beard_full + m.beard_length + 0.10
    if face > reach + 0.15 or y > 0.20 or z < -0.25:
        return max(face - reach, 0.05)
    # Positive where it grows: below a line from the ear to the nose, before the ear, off the lips.
    top = -0.290 + 0.60 * max(ax - 0.15, 0.0) + 1.1 * max(0.19 - z, 0.0)
    # Under the nose there is the moustache only.
    top -= 0.16 * smooth_step(0.20, 0.13, ax)
    cover = union(0.75 * (top - y), z - 0.045 + 0.25 * smooth_step(-0.30, -0.55, y), 0.04)
    cover = min(cover, 0.06 - y)
    lips = (sqrt((ax / 0.105) ** 2 + ((y - gap + 0.020) / 0.034) ** 2) - 1.0) * 0.038
    cover = min(cover, lips)
    thick = m.beard_full * (0.30 + 0.70 * smooth_step(-0.10, -0.46, y))
    d = carve(face - thick, cover, 0.09)
    hang = ellipsoid(x, y + 0.58 + m.chin_drop + 0.4 * m.beard_length, z - 0.36 - m.chin_forward,
                     0.215 * m.jaw_width, 0.16 + 0.7 * m.beard_length, 0.185)
    d = union(d, hang, 0.10)
    d = carve(d, lips, 0.03)
    base = -0.334 - 0.8 * m.nose_length
    if abs(d) < 0.08:
        turn = atan2(x, z + 0.10) + 0.05 * noise(6.0 * x, 9.0 * y, 6.0 * z)
        locks = 0.012 * noise(turn * 13.0, 4.0 * y, 2.0) + 0.008 * noise(turn * 34.0, 7.0 * y, 5.0)
        locks += 0.004 * noise(turn * 80.0, 10.0 * y, 7.0)
        # Where it begins it is even.
        d -= locks * (0.25 + 0.75 * smooth_step(0.0, 0.10, cover))
    lip = capsule(ax, y, z, 0.024, base, 0.522, 0.200, gap - 0.045, 0.478, 0.050, 0.032)
    if abs(lip) < 0.05:
        across = y + 0.45 * ax
        lip -= 0.007 * noise(35.0 * across, 5.0 * x, 1.0) + 0.004 * noise(90.0 * across, 9.0 * x,
                                                                          2.0)
    return union(d, lip, 0.012)
