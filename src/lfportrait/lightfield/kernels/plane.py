"""Directions in a plane: spherical harmonics as functions of one angle.

All rays of a panel's row lie in one plane (see `slices`). With phi, the angle in the plane from the
panel's normal, spherical harmonics of degree 2 are a combination of 1, cos phi, sin phi, sin 2 phi
and cos 2 phi; over a view cone, cos 2 phi is next to a straight line in cos phi.
"""

from __future__ import annotations

import numpy as np

from ...field.marching import sh_basis
from ...lanes.cache_keys import identified
from ...lanes.decorators import lean, lean_kernel

__all__ = ["least_cosine", "plane_matrix"]


@identified("plane matrix")
@lean_kernel
def plane_matrix(across, along, count, least, matrix, scratch):
    """Spherical harmonics in the plane of two unit vectors, as coefficients of its angle.

    A direction is ``cos(phi) along + sin(phi) across``, with cosines of ``least`` to 1.
    ``matrix`` float32 [count * 16] is filled: for each coefficient its weights in the four terms of
    a channel, in lanes ``4 * channel + term``, the same for all three channels. ``scratch`` float32
    [5 * 16].
    """
    # The straight line nearest to cos(2 phi) = 2 cos(phi)^2 - 1 over the cosines that occur.
    tilt = np.float32(2.0) * (np.float32(1.0) + least)
    level = -tilt + np.float32(1.0) - np.float32(0.25) * (np.float32(1.0) - least) ** 2
    root = np.float32(np.sqrt(0.5))
    for probe in range(5):
        c = np.float32(1.0 if probe == 0 else (-1.0 if probe == 1 else 0.0))
        s = np.float32(1.0 if probe == 2 else (-1.0 if probe == 3 else 0.0))
        if probe == 4:
            c, s = root, root
        sh_basis(c * along[0] + s * across[0], c * along[1] + s * across[1],
                 c * along[2] + s * across[2], scratch, 16 * probe, count)
    matrix[:] = np.float32(0.0)
    half = np.float32(0.5)
    for part in range(count):
        ahead, back = scratch[part], scratch[16 + part]
        right, left, oblique = scratch[32 + part], scratch[48 + part], scratch[64 + part]
        cosine, sine = half * (ahead - back), half * (right - left)
        constant = np.float32(0.25) * (ahead + back + right + left)
        double = np.float32(0.25) * (ahead + back - right - left)
        mixed = oblique - constant - root * (cosine + sine)
        for channel in range(3):
            place = 16 * part + 4 * channel
            matrix[place] = constant + level * double
            matrix[place + 1] = cosine + tilt * double
            matrix[place + 2], matrix[place + 3] = sine, mixed


@identified("least cosine")
@lean
def least_cosine(nx, nz, side, depth, eyes, aspect, distance):
    """The least cosine in their plane of the rays that meet the lattice.

    ``side`` and ``depth`` give x and z in the display frame of the lattice's point (i, k) as
    (per i, per k, at zero); ``eyes`` float64 [V] are the eyes' x, ``aspect`` half the panel's width
    and ``distance`` its distance from the eyes.
    """
    left, right = aspect, -aspect
    for i in (0, nx - 1):
        for k in (0, nz - 1):
            away = (depth[0] * i + depth[1] * k + depth[2]) / distance
            across = side[0] * i + side[1] * k + side[2]
            for eye in (eyes[0], eyes[-1]):
                px = min(max((across - eye * away) / (1.0 - away), -aspect), aspect)
                left, right = min(left, px), max(right, px)
    most = max(eyes[0], eyes[-1]) - left
    most = max(most, right - min(eyes[0], eyes[-1]))
    return np.float32(distance / np.sqrt(distance * distance + most * most))
