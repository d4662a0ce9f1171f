"""Plain NumPy twins of the ray-casting kernels: one ray at a time, float64, no skipping."""

import numpy as np

C0, C1 = 0.28209479177387814, 0.4886025119029199
C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792,
      0.5462742152960396)


def sh_basis(direction, count):
    x, y, z = direction
    values = [C0, -C1 * y, C1 * z, -C1 * x, C2[0] * x * y, C2[1] * y * z,
              C2[2] * (2 * z * z - x * x - y * y), C2[3] * x * z, C2[4] * (x * x - y * y)]
    return np.array(values[:count])


CORNERS = np.array([[corner & 1, (corner >> 1) & 1, corner >> 2] for corner in range(8)])
"""Of a cell, (x, y, z)."""


def trilinear(position, shape):
    """The eight corners [8, 3] (z, y, x) of a position (x, y, z) and their weights [8]."""
    cell = np.minimum(np.maximum(np.floor(position), 0), np.array(shape[::-1]) - 2).astype(int)
    part = position - cell
    return (cell + CORNERS)[:, ::-1], np.where(CORNERS, part, 1 - part).prod(axis=1)


def cast(field, origin, direction, step=0.5, threshold=1e-2, stop=1e-3, toward=None):
    """Color [3] without background, transmittance, distance of the surface in lattice units,
    and the samples [(rows, weights, weight, delta, number of the step)], for a world ray; colors
    as seen along ``toward`` if it is given."""
    shape = field.links.shape
    size = np.array(shape[::-1], float)
    scale = size / (2 * field.radius)
    offset = size / 2 - 0.5 - field.center * scale
    unit = direction / np.linalg.norm(direction)
    seen = unit if toward is None else toward / np.linalg.norm(toward)
    basis = sh_basis(seen, field.sh.shape[2])
    start_point, along = origin * scale + offset, unit * scale
    norm = np.linalg.norm(along)
    along = along / norm
    delta = step / norm
    with np.errstate(divide="ignore"):
        a, b = -start_point / along, (size - 1 - start_point) / along
    enter, leave = max(0.0, np.minimum(a, b).max()), np.maximum(a, b).min()
    color, through, surface, samples = np.zeros(3), 1.0, np.inf, []
    k = 0
    while enter + k * step < leave and through > stop:
        t = enter + k * step
        k += 1
        corners, weights = trilinear(start_point + t * along, shape)
        rows = field.links[tuple(corners.T)]
        there = rows >= 0
        sigma = (weights * np.where(there, field.density[rows], 0.0)).sum()
        if sigma <= threshold:
            continue
        coefficients = (weights[:, None, None] * np.where(there[:, None, None], field.sh[rows], 0)
                        ).sum(0)
        shade = np.maximum(coefficients @ basis + 0.5, 0.0)
        fade = np.exp(-sigma * delta)
        weight = through * (1 - fade)
        color += weight * shade
        samples.append((rows, weights, weight, delta, k - 1))
        if through >= 0.5 > through * fade:
            surface = t + ((through - 0.5) / (through - through * fade) - 0.5) * step
        through *= fade
    return color, through, surface, samples
