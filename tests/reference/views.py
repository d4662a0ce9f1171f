"""Plain NumPy twin of the rendering of level cameras by slices: one pixel at a time."""

import numpy as np

from .slices import cast


def pixel(field, cameras, view, x, y, threshold=0.0, stop=0.0):
    """Color [3] without background and transmittance of a pixel, by slices (`slices.cast`)."""
    # A display of which the camera is the eye, at distance 1: right, up and back are its axes.
    axes = cameras.pose[view, :3, :3] * (1.0, -1.0, -1.0)
    eye = np.array([0.0, 0.0, 1.0])
    size = np.array(field.links.shape[::-1])
    scale = size / (2 * field.radius)
    origin = cameras.pose[view, :3, 3] - axes @ eye
    matrix = np.column_stack([scale[:, None] * axes,
                              size / 2 - 0.5 + (origin - field.center) * scale])
    column, row = (np.array([x, y]) + 0.5 - cameras.center[view]) / cameras.focal[view]
    return cast(field, matrix, axes, eye, np.array([column, -row, 0.0]), 1, threshold, stop)
