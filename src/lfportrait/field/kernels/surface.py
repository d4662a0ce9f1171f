"""The outer surface of a field: how much matter lies before a point, and the color seen there.

`depth_from_outside` walks through the lattice along directions whose steps lead from lattice point
to lattice point (a neighbour's offset, diagonals included), so that nothing is interpolated. The
minimum over the directions separates outside from inside, whatever the field holds behind its
surface.
"""

from __future__ import annotations

import numpy as np

from ...simd.decorators import identified, kernel, lean_kernel
from ...simd.threads import shared
from .march import sh_basis

__all__ = ["depth_from_outside", "seen_colors", "sh_bases"]


def _across_planes(density, dz, dy, dx, length, least):
    """One direction with ``dz`` = -1 or 1: plane after plane."""
    before, here = np.zeros((2, *density.shape[1:]), np.float32)
    for k in range(len(density))[::dz]:
        behind = k - dz if 0 <= k - dz < len(density) else -1
        _next_plane(density, k, behind, dy, dx, np.float32(0.5) * length, before, here, least)
        before, here = here, before


@shared("here")
@lean_kernel
def _next_plane(since, until, density, k, behind, dy, dx, half, before, here, least):
    """Depths ``here`` on plane ``k`` from those on plane ``behind`` it, -1 for the outside."""
    rows, columns = here.shape
    for j in range(since, until):
        jj = j - dy
        for i in range(columns):
            ii = i - dx
            own = density[k, j, i]
            if behind >= 0 and 0 <= jj < rows and 0 <= ii < columns:
                value = before[jj, ii] + half * (own + density[behind, jj, ii])
            else:
                value = half * own
            here[j, i] = value
            least[k, j, i] = min(least[k, j, i], value)


@shared("density")
@kernel
def _inside_planes(since, until, density, dy, dx, length, least):
    """One direction within the planes of constant z."""
    rows, columns = density.shape[1:]
    half = np.float32(0.5) * length
    for k in range(since, until):
        before = np.zeros(columns, np.float32)
        here = np.zeros(columns, np.float32)
        for number in range(rows):
            j = rows - 1 - number if dy < 0 else number
            jj = j - dy
            for count in range(columns):
                i = columns - 1 - count if dx < 0 else count
                ii = i - dx
                value = half * density[k, j, i]
                if 0 <= jj < rows and 0 <= ii < columns:
                    value += half * density[k, jj, ii]
                    value += here[ii] if dy == 0 else before[ii]
                here[i] = value
                if value < least[k, j, i]:
                    least[k, j, i] = value
            before, here = here, before


def depth_from_outside(density, spacing, directions):
    """Optical depth between each lattice point and the outside, along the best direction.

    Parameters
    ----------
    density
        float32 [Z, Y, X], per world unit; linear between lattice points, zero beyond them.
    spacing
        float [3], distance of lattice points along z, y, x in world units.
    directions
        int [D, 3], steps (z, y, x) of -1, 0 or 1 in which light may come in; none all zero.

    Returns
    -------
    depth
        float32 [Z, Y, X]; light that comes in is dimmed by exp(-depth).
    """
    least = np.full(density.shape, np.inf, np.float32)
    for dz, dy, dx in np.asarray(directions, np.int64):
        length = np.float32(np.linalg.norm(np.array([dz, dy, dx]) * np.asarray(spacing)))
        if dz != 0:
            _across_planes(density, dz, dy, dx, length, least)
        else:
            _inside_planes(density, dy, dx, length, least)
    return least


@shared("origins")
@identified("seen_colors")
@kernel
def seen_colors(since, until, links, density, sh, scale, offset, origins, directions, steps, step,
                color):
    """Volume-rendered color of short rays, of which each has its own direction.

    Parameters
    ----------
    links
        int32 [Z, Y, X], row of each lattice point, -1 where it is empty.
    density, sh
        float32 [N] and [N, 3, B].
    scale, offset
        float64 [3] (x, y, z): lattice coordinate = world * scale + offset.
    origins, directions
        float64 [K, 3] in the world; directions have unit length.
    steps, step
        Number of samples of a ray and their distance in world units.
    color
        float32 [K, 4] out: mean color of what the ray meets, and its opacity.
    """
    count = sh.shape[2]
    depth, height, width = links.shape
    for ray in range(since, until):
        basis = np.empty(count, np.float32)
        sh_basis(np.float32(directions[ray, 0]), np.float32(directions[ray, 1]),
                 np.float32(directions[ray, 2]), basis, 0, count)
        through = np.float32(1.0)
        total = np.zeros(3, np.float32)
        for sample in range(steps):
            along = (sample + 0.5) * step
            x = (origins[ray, 0] + along * directions[ray, 0]) * scale[0] + offset[0]
            y = (origins[ray, 1] + along * directions[ray, 1]) * scale[1] + offset[1]
            z = (origins[ray, 2] + along * directions[ray, 2]) * scale[2] + offset[2]
            if not (0.0 <= x <= width - 1 and 0.0 <= y <= height - 1 and 0.0 <= z <= depth - 1):
                continue
            i, j, k = min(int(x), width - 2), min(int(y), height - 2), min(int(z), depth - 2)
            fx, fy, fz = np.float32(x - i), np.float32(y - j), np.float32(z - k)
            sigma = np.float32(0.0)
            for corner in range(8):
                row = links[k + (corner >> 2), j + ((corner >> 1) & 1), i + (corner & 1)]
                if row >= 0:
                    sigma += (density[row] * (fx if corner & 1 else np.float32(1.0) - fx)
                              * (fy if corner & 2 else np.float32(1.0) - fy)
                              * (fz if corner & 4 else np.float32(1.0) - fz))
            if sigma <= np.float32(0.0):
                continue
            fade = np.float32(np.exp(-sigma * step))
            weight = through * (np.float32(1.0) - fade)
            through *= fade
            for channel in range(3):
                value = np.float32(0.5)
                for corner in range(8):
                    row = links[k + (corner >> 2), j + ((corner >> 1) & 1), i + (corner & 1)]
                    if row >= 0:
                        share = ((fx if corner & 1 else np.float32(1.0) - fx)
                                 * (fy if corner & 2 else np.float32(1.0) - fy)
                                 * (fz if corner & 4 else np.float32(1.0) - fz))
                        for number in range(count):
                            value += share * sh[row, channel, number] * basis[number]
                total[channel] += weight * max(value, np.float32(0.0))
        opacity = np.float32(1.0) - through
        for channel in range(3):
            color[ray, channel] = total[channel] / max(opacity, np.float32(1e-12))
        color[ray, 3] = opacity


@identified("sh_bases")
@lean_kernel
def sh_bases(directions, bases):
    """Spherical harmonics of unit directions, float64 [K, 3], into float32 [K, B]."""
    for row in range(len(directions)):
        sh_basis(np.float32(directions[row, 0]), np.float32(directions[row, 1]),
                 np.float32(directions[row, 2]), bases[row], 0, bases.shape[1])
