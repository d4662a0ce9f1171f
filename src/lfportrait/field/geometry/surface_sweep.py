"""Surface sweeps: where along a chart's rays all photos agree best.

The surface is moved outwards and inwards step by step, the photos are looked up at each place, and
their normalised cross-correlation with their mean, as a likelihood, shows where they agree: a plane
sweep (Collins 1996) along a surface instead of along planes.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import cv2
import numba
import numpy as np

from ...arrays import Float32, Float64, UInt8
from ...capture import Camera
from .chart import Chart, normals_of

__all__ = ["SurfaceSweep", "cosines_of"]


def cosines_of(chart: Chart, distance: Float64, cameras: Camera) -> list[Float64]:
    """How squarely each camera looks at a surface.

    Parameters
    ----------
    chart, distance
        The surface, float64 [V, U], world units.
    cameras
        In the world.

    Returns
    -------
    cosines
        One a camera, float64 [V, U]: between the normal and the way to the camera, -1 where the
        surface hides itself.
    """
    points, normal = chart.points(distance), normals_of(chart, distance)
    cell, found = chart.cell / chart.scale, []
    for view, position in enumerate(cameras.position):
        away = position - points
        cosine = (away * normal).sum(axis=-1) / np.linalg.norm(away, axis=-1)
        pixels, depth = (part[0] for part in cameras[view].project(points.reshape(-1, 3)))
        # The nearest point of each block of pixels hides what lies far behind it.
        block = 3.0 * cell * cameras.focal[view].max() / np.median(depth)
        place = np.floor(pixels / block).astype(int)
        place -= place.min(axis=0)
        nearest = np.full(tuple(place.max(axis=0) + 1), np.inf)
        np.minimum.at(nearest, tuple(place.T), depth)
        hidden = depth > nearest[tuple(place.T)] + 5.0 * cell
        found.append(np.where(hidden.reshape(cosine.shape), -1.0, cosine))
    return found


class SurfaceSweep:
    """Grey photos, reduced to pixels as wide as a cell, that a surface is looked up in."""

    def __init__(self, images: Sequence[UInt8], cameras: Camera, cell: float) -> None:
        factor = float(np.clip(2.0 * cameras.pixel / cell, 0.1, 1.0))
        self.cameras = cameras.scaled(factor)
        self.greys = [cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255,
                                 (int(self.cameras.width[k]), int(self.cameras.height[k])),
                                 interpolation=cv2.INTER_AREA) for k, image in enumerate(images)]

    def sweep(self, chart: Chart, distance: Float64, limit: Float64, reach: float, steps: int,
              window: int) -> tuple[Float64, Float64]:
        """Where around a surface the photos agree best.

        Parameters
        ----------
        chart, distance
            The surface, float64 [V, U], world units.
        limit
            Distances beyond which nothing is looked for, float64 [V, U].
        reach, steps
            How far outwards and inwards is looked, world units, and at how many places.
        window
            Width of the correlation's window in cells.

        Returns
        -------
        offset, trust
            float64 [V, U] each: outwards from the surface, and the photos' confidence in [0, 1].
        """
        weights = []
        for cosine in cosines_of(chart, distance, self.cameras):
            weights.append(np.clip((cosine - 0.15) / 0.3, 0, 1).astype(np.float32))
        offsets = np.linspace(-reach, reach, steps)
        with ThreadPoolExecutor(numba.get_num_threads()) as workers:
            parts = list(workers.map(
                lambda by: self._agreement(chart.points(distance + by), weights, window), offsets))
        scores = np.stack([part[0] for part in parts])
        texture = parts[len(parts) // 2][1]
        scores[(distance + offsets[:, None, None]) > limit + 0.2 * reach] = 0.0
        scores = np.stack([cv2.GaussianBlur(score, (0, 0), window / 5) for score in scores])
        best = scores.argmax(axis=0)
        inner = np.clip(best, 1, steps - 2)
        below, top, above = (np.take_along_axis(scores, (inner + by)[None], 0)[0]
                             for by in (-1, 0, 1))
        bend = np.minimum(below + above - 2 * top, -1e-6)
        shift = np.clip(0.5 * (below - above) / bend, -0.5, 0.5)
        offset = (inner + shift - (steps - 1) / 2) * (offsets[1] - offsets[0])
        # If the photos agree as well elsewhere, or at the end of the range, they do not determine
        # it.
        spread = top - np.median(scores, axis=0)
        sure = (best == inner) & (top > 1.0)
        trust = np.where(sure, np.clip(spread / 1.5, 0, 1) * texture / (texture + 1.5e-5), 0.0)
        return offset, trust

    def _agreement(self, points: Float64, weights: Sequence[Float32], window: int,
                   ) -> tuple[Float32, Float32]:
        """Mean correlation of the photos with their mean, and the mean's variance, [V, U] each."""
        flat, shape = points.reshape(-1, 3), points.shape[:2]
        size = (window, window)
        values, shares = [], []
        for view, grey in enumerate(self.greys):
            pixels = self.cameras[view].project(flat)[0][0]
            maps = (pixels - 0.5).astype(np.float32).reshape(*shape, 2)
            value = cv2.remap(grey, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR,
                              borderMode=cv2.BORDER_CONSTANT, borderValue=-1.0)
            share = np.where(value >= 0, weights[view], 0).astype(np.float32)
            value = np.maximum(value, 0)
            values.append(value - cv2.boxFilter(value, -1, size))
            shares.append(share)
        stack, weight = np.stack(values), np.stack(shares)
        total = np.maximum(weight.sum(axis=0), 1e-6)
        mean = (weight * stack).sum(axis=0) / total
        own = cv2.boxFilter(mean * mean, -1, size)
        score = np.zeros(shape, np.float32)
        for value, share in zip(stack, weight):
            together = cv2.boxFilter(value * mean, -1, size)
            variance = cv2.boxFilter(value * value, -1, size)
            score += share * together / np.sqrt(np.maximum(variance * own, 1e-12))
        share = np.clip(score / total, 0.0, 1.0)
        # The likelihood of an agreement, but for a factor: what misfits is noise.
        logarithm = np.where(total > 0.25 * len(stack), -np.log(1.003 - share), 0.0)
        return logarithm.astype(np.float32), own
