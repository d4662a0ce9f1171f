"""Plain NumPy twin of the coding by slices: one sub-pixel at a time, float64, no skipping."""

import numpy as np

from .raycast import sh_basis


def _point(field, i, k, y):
    """Density and coefficients at column i of plane k, between two rows of the lattice."""
    ny, nx = field.links.shape[1:]
    empty = 0.0, np.zeros(field.sh.shape[1:])
    if not (0 <= i < nx and 0 <= y <= ny - 1):
        return empty
    row = min(int(y), ny - 2)
    density, coefficients = empty
    for place, share in ((row, 1 - (y - row)), (row + 1, y - row)):
        link = field.links[k, place, i]
        if link >= 0:
            density = density + share * field.density[link]
            coefficients = coefficients + share * field.sh[link]
    return density, coefficients


def cast(field, matrix, to_world, eye, place, stride=1, threshold=0.0, stop=0.0):
    """Color [3] without background and transmittance of the ray from eye to place (display
    frame); ``matrix`` [3, 4] takes that frame to the lattice."""
    nz = field.links.shape[0]
    scale = np.array(field.links.shape[::-1]) / (2 * field.radius)
    direction = np.asarray(place, float) - eye
    ahead = matrix[:, :3] @ direction
    start = matrix[:, :3] @ eye + matrix[:, 3]
    world = to_world @ direction
    basis = sh_basis(world / np.linalg.norm(world), field.sh.shape[2])
    # A step from one plane to the next, in the field's world.
    delta = stride * np.linalg.norm(ahead / ahead[2] / scale)
    inverse = np.linalg.inv(matrix[:, :3])
    color, through = np.zeros(3), 1.0
    for k in range(nz - 1, -1, -stride):
        t = (k - start[2]) / ahead[2]
        x = start[0] + t * ahead[0]
        column, points = int(np.floor(x)), []
        for i in (column, column + 1):
            # Where the plane of the eyes' line and the panel's row passes through (i, k).
            depth = (inverse @ (np.array([i, 0.0, k]) - matrix[:, 3]))[2]
            height = place[1] + (eye[1] - place[1]) * depth / eye[2]
            points.append(_point(field, i, k, matrix[1, 1] * height + matrix[1, 3]))
        part = x - column
        sigma = (1 - part) * points[0][0] + part * points[1][0]
        if sigma <= threshold:
            continue
        coefficients = (1 - part) * points[0][1] + part * points[1][1]
        fade = np.exp(-sigma * delta)
        color += through * (1 - fade) * np.maximum(coefficients @ basis + 0.5, 0)
        through *= fade
        if through <= stop:
            return color / (1 - through), 0.0
    return color, through
