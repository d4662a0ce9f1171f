"""The tufts of short hair that no photo shows.

Short hair has no strands that run down from the crown, but it is not smooth, either: tufts of it
lie away from a whorl, each a few times as long as wide. They are noise in space that is drawn out
along the surface (line integral convolution, Cabral and Leedom 1993), so that it has no seam, in
octaves of a strand's width, each with its contrast in the photo, and as long as hair there has a
direction.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float32, Float64

WHORL = np.array([0.0, 0.52, -0.38])  # Tufts lie away from here, portrait frame.
MOST = 2.0  # About so many standard deviations one is brighter or darker, at most.
WAVE, TURNED, SPIRAL = 0.2, 0.5, 1.0
"""Over how much the direction of tufts changes, portrait units; by how much, and how much they turn
around the whorl, radians."""
ROUND, SHORTER = 0.1, 0.7
"""Over how much they turn so, portrait units; and they are no longer than such a part of the way to
the whorl."""
SIDE = 48  # Of the noise, in a tuft's width, after which it repeats.
FEWEST = 200  # Fewer places are no surface that has a deviation of its own.
SAMPLES, LENGTH = 5, 5.0  # Along a tuft, and how long it is over its width, at most.
LONGEST = 0.2  # Portrait units.
ALIGNED = (0.3, 0.6)
"""Coherence of a photo's gradients in hair (`aligned`) of which tufts have no direction, as in hair
of some millimeters, and from which on they are as long as that."""
BROAD = np.array([1.0, 1.0, 0.7, 0.5])
"""Parts of octaves that are tufts: the rest is light and cut, which are others behind. Of hair that
has no direction, their cubes."""


def tufts(points: Float64, normals: Float64, widths: tuple[float, ...], contrast: Float64,
          coherence: float) -> Float64:
    """Factors [N] of the brightness of places [N, 3] (portrait frame) in short hair.

    Parameters
    ----------
    normals : float64 [N, 3], outward.
    widths, contrast : Of octaves, portrait units and standard deviations of the logarithm.
    coherence : By which they are long (`aligned`).
    """
    if len(points) < FEWEST or not contrast.any():
        return np.ones(len(points))
    away = points - WHORL
    along = away - (away * normals).sum(axis=1)[:, None] * normals
    length = np.linalg.norm(along, axis=1)[:, None]
    along /= np.maximum(length, 1e-9)
    random = np.random.default_rng(7)
    # It turns around the whorl, and no tuft lies quite like the next.
    wave = _noise(random.standard_normal((SIDE,) * 3), points / WAVE)[:, None]
    turn = TURNED * wave + SPIRAL * np.exp(-length / ROUND)
    along = np.cos(turn) * along + np.sin(turn) * np.cross(normals, along)
    out = np.zeros(len(points))
    share = float(np.clip((coherence - ALIGNED[0]) / (ALIGNED[1] - ALIGNED[0]), 0, 1))
    contrast, longest = contrast * BROAD ** (3 - 2 * share), (LENGTH - 1) * share
    for width, strength in zip(widths, contrast, strict=True):
        lattice = random.standard_normal((SIDE,) * 3)
        noise = np.zeros(len(points))
        whole = np.minimum(min(longest, LONGEST / width), SHORTER / width * length) * along
        for step in np.linspace(-0.5, 0.5, SAMPLES) if longest else np.zeros(1):
            noise += _noise(lattice, points / width + step * whole)
        out += strength * noise / max(float(noise.std()), 1e-9)
    strong = float(np.linalg.norm(contrast))
    bounded = np.tanh(out / max(MOST * strong, 1e-9))
    return np.asarray(np.exp(bounded * (strong / max(float(bounded.std()), 1e-9))))


def _noise(lattice: Float64, places: Float64) -> Float64:
    """Values of a lattice that repeats, at places [N, 3], [N]."""
    return np.asarray(ndimage.map_coordinates(lattice, places.T, order=1, mode="grid-wrap"))


def aligned(colors: NDArray[np.floating], hair: Bool, pixels: float, width: float) -> float:
    """How much a photo's hair runs in one direction from place to place, 0 to 1.

    The coherence of its structure tensor (Bigun and Granlund 1987), in the octave of a width.

    Parameters
    ----------
    colors, hair : [H, W, 3] in [0, 1]; bool [H, W].
    pixels, width : Of a portrait unit; in portrait units.
    """
    factor = min(1.0, 4.0 / (width * pixels))
    size = tuple(max(2, round(side * factor)) for side in hair.shape[::-1])
    light = np.log(cv2.resize(np.asarray(colors, np.float32).mean(axis=2), size,
                              interpolation=cv2.INTER_AREA) + np.float32(0.02))
    inside = cv2.resize(hair.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.99
    known, scale = inside.astype(np.float32), width * pixels * factor

    def mean(values: NDArray[np.floating], sigma: float) -> Float32:
        return np.asarray(cv2.GaussianBlur(values * known, (0, 0), sigma * scale)
                          / np.maximum(cv2.GaussianBlur(known, (0, 0), sigma * scale), 1e-3),
                          np.float32)

    octave = mean(light, 0.3) - mean(light, 0.6)
    x, y = (cv2.Sobel(octave, cv2.CV_32F, *one, ksize=3) for one in ((1, 0), (0, 1)))
    xx, yy, xy = (mean(one, 0.8) for one in (x * x, y * y, x * y))
    total = float((xx + yy)[inside].sum())
    return float(np.hypot(xx - yy, 2 * xy)[inside].sum()) / total if total > 0 else 0.0
