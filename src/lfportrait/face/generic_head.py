"""A generic head: its 68 landmarks and the depth map of its face.

The frame is the portrait frame (+x to the sitter's left, +y up, +z out of the face), the face is
about 0.8 wide. Across, its landmarks are those of the
embedded head, in depth they follow common proportions. Between them depth is a thin-plate
spline; around them lies an egg for skull and hair; below the chin a neck, and what is further away
is a plane through the head's middle.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Float64

__all__ = ["EGG", "GENERIC_LANDMARKS", "MIRRORED", "generic_depth"]


GENERIC_LANDMARKS: Float64 = np.array([
    (-0.403, 0.003, 0.180), (-0.402, -0.065, 0.190), (-0.369, -0.146, 0.210),
    (-0.343, -0.240, 0.250), (-0.329, -0.345, 0.320), (-0.288, -0.447, 0.410),
    (-0.208, -0.529, 0.500), (-0.109, -0.592, 0.555), (0.000, -0.638, 0.575),
    (0.109, -0.592, 0.555), (0.208, -0.529, 0.500), (0.288, -0.447, 0.410),
    (0.329, -0.345, 0.320), (0.343, -0.240, 0.250), (0.369, -0.146, 0.210),
    (0.402, -0.065, 0.190), (0.403, 0.003, 0.180), (-0.326, 0.121, 0.410),
    (-0.264, 0.142, 0.470), (-0.200, 0.151, 0.510), (-0.135, 0.146, 0.540),
    (-0.076, 0.129, 0.555), (0.076, 0.129, 0.555), (0.135, 0.146, 0.540),
    (0.200, 0.151, 0.510), (0.264, 0.142, 0.470), (0.326, 0.121, 0.410),
    (0.000, 0.008, 0.535), (0.000, -0.065, 0.580), (0.000, -0.127, 0.630),
    (0.000, -0.188, 0.680), (-0.060, -0.240, 0.575), (-0.025, -0.248, 0.605),
    (0.000, -0.252, 0.630), (0.025, -0.248, 0.605), (0.060, -0.240, 0.575),
    (-0.270, 0.012, 0.430), (-0.213, 0.034, 0.475), (-0.147, 0.033, 0.485),
    (-0.090, 0.000, 0.480), (-0.147, -0.024, 0.475), (-0.213, -0.023, 0.465),
    (0.090, 0.000, 0.480), (0.147, 0.033, 0.485), (0.213, 0.034, 0.475),
    (0.270, 0.012, 0.430), (0.213, -0.023, 0.465), (0.147, -0.024, 0.475),
    (-0.133, -0.379, 0.550), (-0.083, -0.361, 0.600), (-0.032, -0.347, 0.635),
    (0.000, -0.357, 0.635), (0.032, -0.347, 0.635), (0.083, -0.361, 0.600),
    (0.133, -0.379, 0.550), (0.083, -0.422, 0.600), (0.038, -0.443, 0.625),
    (0.000, -0.452, 0.630), (-0.038, -0.443, 0.625), (-0.083, -0.422, 0.600),
    (-0.116, -0.381, 0.560), (-0.054, -0.389, 0.610), (0.000, -0.396, 0.620),
    (0.054, -0.389, 0.610), (0.116, -0.381, 0.560), (0.054, -0.393, 0.610),
    (0.000, -0.400, 0.620), (-0.054, -0.393, 0.610),
])
"""float64 [68, 3], iBUG order, mirror-symmetric."""

MIRRORED = np.array([
    *range(16, -1, -1), *range(26, 16, -1), 27, 28, 29, 30, 35, 34, 33, 32, 31,
    45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40, 54, 53, 52, 51, 50, 49, 48,
    59, 58, 57, 56, 55, 64, 63, 62, 61, 60, 67, 66, 65])
"""Number of each landmark's mirror image."""

_SKULL = np.array([0.0, 0.12, 0.0])
EGG = np.array([0.47, 0.68, 0.52])
"""Half axes of the egg for skull and hair."""
_BEHIND = -0.05
"""Depth of what lies around the head."""


def generic_depth(x: Float64, y: Float64, landmarks: Float64 = GENERIC_LANDMARKS) -> Float64:
    """Depth of the head's front surface at places (x, y), any one shape, float64.

    Continuous; the face's where there is a face, the egg's around it, next to none beyond.
    ``landmarks`` [68, 3] are of a face of other proportions.
    """
    from scipy.interpolate import RBFInterpolator

    egg = 1 - ((x - _SKULL[0]) / EGG[0]) ** 2 - ((y - _SKULL[1]) / EGG[1]) ** 2
    skull = np.where(egg > 0, _SKULL[2] + EGG[2] * np.sqrt(np.maximum(egg, 0)), _BEHIND)
    # The face ends where its landmarks end; the brows' line goes on a little into the forehead.
    spline = RBFInterpolator(landmarks[:, :2], landmarks[:, 2],
                             kernel="thin_plate_spline", smoothing=1e-4)
    low, high = landmarks[8, 1], landmarks[17:27, 1].max()
    middle, half = (low + high) / 2, (high - low) / 2
    away = np.sqrt((x / landmarks[16, 0]) ** 2 + ((y - middle) / (1.25 * half)) ** 2)
    share = np.clip((1.15 - away) / 0.3, 0, 1)
    share = share * share * (3 - 2 * share)
    face, near = np.zeros(np.shape(x)), share > 0
    if near.any():
        face[near] = spline(np.stack([x[near], y[near]], axis=1))
    return np.asarray(share * face + (1 - share) * np.maximum(skull, _BEHIND), np.float64)
