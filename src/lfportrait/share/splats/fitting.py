"""Splats fitted to what a field shows: colors, opacities, sizes and places, by gradient descent.

A view is rendered by the field and by the splats; the derivative of their squared difference, in
color on black and in opacity, moves the splats (Adam, Kingma and Ba 2015). Of three views two are
close-ups, so that splats stay as large as the gaps between them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...capture import Camera
from ...field import VoxelField
from .cloud import Splats, splat_view
from .placing import Ball

__all__ = ["fit_splats"]

Float32 = NDArray[np.float32]

PITCH = (-35.0, 60.0)
"""Of the views, in degrees."""
CLOSE = (1.0, 2.0, 2.0)
"""How large views show the head, one after the other; 1 shows all of it."""
RATES = {"opacity": 0.2, "scales": 0.06, "positions": 0.1}
"""Step sizes: of the logit of the opacity, of the logarithm of the scales, and of places in widths
of the splat. They fall to a tenth."""
KEPT = 0.93
"""How much of a splat's weight in the views before counts, beside that in a view, when its color is
corrected: about fifteen views have a say."""
FIRST, SECOND = 0.9, 0.97
"""How much of the means of the derivatives and of their squares stays at each step."""


class _Adam:
    """Steps of one array, of those rows alone that a view shows."""

    def __init__(self, values: Float32, rate: float) -> None:
        self.values, self.rate = values, rate
        self.mean, self.square = np.zeros_like(values), np.zeros_like(values)
        self.seen = np.zeros(len(values), np.float32)

    def step(self, rows: NDArray[np.int64], slope: Float32, share: float) -> None:
        """Move ``rows`` against the derivatives ``slope`` [M, ...], by a share of the rate."""
        self.seen[rows] += 1
        mean = FIRST * self.mean[rows] + (1 - FIRST) * slope
        square = SECOND * self.square[rows] + (1 - SECOND) * slope * slope
        self.mean[rows], self.square[rows] = mean, square
        seen = self.seen[rows].reshape(-1, *[1] * (slope.ndim - 1))
        mean /= 1 - FIRST ** seen
        square /= 1 - SECOND ** seen
        size = np.sqrt(square)
        # What hardly matters hardly moves.
        self.values[rows] -= np.float32(self.rate * share) * mean / (size + size.mean() + 1e-12)


def fit_splats(field: VoxelField, splats: Splats, steps: int, seed: int = 0,
               tell: Callable[[int], None] = lambda step: None) -> Splats:
    """Fit splats to a field.

    Parameters
    ----------
    field
        The field.
    splats
        As `place_splats` lays them.
    steps
        How many views are looked at.
    seed
        Of the choice of views.
    tell
        Told the number of each step.
    """
    width, start = splats.scales[:, 0].copy(), splats.positions
    ball = Ball.around(field)
    logit = np.log(splats.opacity / (1 - splats.opacity))
    parts = {name: _Adam(values, RATES[name]) for name, values in (
        ("opacity", logit), ("scales", np.log(splats.scales)),
        ("positions", np.zeros_like(start)))}
    weights = np.zeros(len(start), np.float32)
    pixels = _pixels(ball, float(np.median(width)))
    for number, camera in enumerate(_views(ball, pixels, steps, seed)):
        tell(number)
        sh = _step(field, splats, camera, parts, weights, width, number / max(steps - 1, 1))
        opacity = (1 / (1 + np.exp(-parts["opacity"].values))).astype(np.float32)
        splats = replace(splats, sh=sh, opacity=opacity, scales=np.exp(parts["scales"].values),
                         positions=start + width[:, None] * parts["positions"].values)
    return splats


def _step(field: VoxelField, splats: Splats, camera: Camera, parts: dict[str, _Adam],
          weights: Float32, width: Float32, done: float) -> Float32:
    """Move the splats that one view shows, and return the colors' new coefficients."""
    shot = field.render(camera, 0, background=0.0)
    target = np.concatenate([np.clip(shot.color, 0, 1), shot.alpha[..., None]], axis=2)
    shown = splat_view(splats, camera)
    slopes = shown.slopes(shown.image - target)
    # Hidden ones are not moved.
    rows = np.flatnonzero(slopes.weights)
    share = 0.1 ** done
    opacity = splats.opacity[rows]
    parts["opacity"].step(rows, slopes.opacity[rows] * opacity * (1 - opacity), share)
    parts["scales"].step(rows, slopes.scales[rows], share)
    parts["positions"].step(rows, slopes.positions[rows] * width[rows, None], share)
    # Pixels are linear in the colors: each gets the mean error of what it shows (SIRT).
    basis = splats.bases(camera.pose[0, :3, 3])[rows]
    weights[rows] = KEPT * weights[rows] + slopes.weights[rows]
    lack = slopes.colors[rows] / (weights[rows, None] * (basis * basis).sum(axis=1, keepdims=True))
    sh = splats.sh.copy()
    sh[rows] -= lack[:, :, None] * basis[:, None]
    return sh


def _pixels(ball: Ball, width: float) -> int:
    """Size of the views: a splat is about one pixel wide."""
    return int(np.clip(1.1 * ball.radius / width, 64, 768))


def _views(ball: Ball, pixels: int, steps: int, seed: int) -> Iterator[Camera]:
    """Cameras all around, evenly spread; of three two are close-ups."""
    random = np.random.default_rng(seed)
    low, high = np.sin(np.radians(PITCH))
    for number in range(steps):
        # A sequence that fills angle and height evenly, however long it gets (Roberts 2018).
        turn = 360 * ((number * 0.7548776662466927 + 0.1 * random.random()) % 1)
        height = low + (high - low) * ((number * 0.5698402909980532 + 0.5) % 1)
        camera = ball.seen(turn, float(np.degrees(np.arcsin(height))), pixels)
        close = CLOSE[number % len(CLOSE)]
        away = (random.random(2) - 0.5) * (close - 1) * 0.5 * pixels
        camera = Camera(camera.pose, camera.focal * close, camera.center + away, camera.width,
                        camera.height)
        yield camera
