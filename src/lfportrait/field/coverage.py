"""Coverage of a head by photos: the number of directions that see each place.

Held-out photos lie between the others, so they say little about what an arc of photos does not
show. A place that is seen from three directions or more has its shape from the photos; one that is
seen from none is a guess.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..capture import Camera, Capture
from .closing.photos import Photos
from .grid import VoxelField, surface_points

__all__ = ["Coverage"]

Float64 = NDArray[np.float64]

_APART = 10.0
"""Degrees between directions that count as two."""
_LEAST = 0.2
"""Cosine between normal and direction below which a photo sees next to nothing of a place."""
_SMOOTH = 2.0
"""Pixels over which normals are smoothed."""
_PIXEL = 2.0
"""Width of the photos' pixels at the head, in voxels: what they show changes slowly over it."""
_TURNS = (-75.0, -45.0, -15.0, 15.0, 45.0, 75.0)
"""Degrees of the views over which the share is taken."""


class Coverage:
    """From how many directions the photos of a capture show the surface of a field.

    Parameters
    ----------
    field
        Of a head, in the capture's frame.
    capture
        The photos.
    """

    ENOUGH = 3
    """Directions from which a place is seen well."""

    def __init__(self, field: VoxelField, capture: Capture) -> None:
        self.field = field
        self._chin = (-np.inf if capture.landmarks is None
                      else float(np.nan_to_num(capture.landmarks[8, 1], nan=-np.inf)))
        photos = Photos(field, capture, pixel=_PIXEL)
        x, y, z = photos.cameras.position.T
        turn, rise = np.degrees(np.arctan2(x, z)), np.degrees(np.arctan2(y, np.hypot(x, z)))
        cells = np.round(np.stack([turn, rise], axis=1) / _APART).astype(int)
        self._direction = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
        self._photos = photos

    def directions(self, cameras: Camera, view: int) -> NDArray[np.int32]:
        """Directions that show what each pixel of a view shows, int32 [H, W]; -1: nothing."""
        return self._seen(cameras, view)[0]

    def _seen(self, cameras: Camera, view: int) -> tuple[NDArray[np.int32], Float64]:
        """The same, and the points that the pixels show, float64 [H, W, 3]."""
        alpha, depth = self.field.depth(cameras, view)
        points = np.asarray(surface_points(cameras, view, depth), np.float64)
        solid = (alpha > 0.5) & np.isfinite(points).all(axis=-1)
        normal = _normals(points, cameras.position[view])
        seen = np.zeros((self._direction.max() + 1, int(solid.sum())), bool)
        votes = self._photos.each(points[solid], normal[solid], _LEAST)
        for photo, sees in enumerate(votes):
            seen[self._direction[photo]] |= sees
        found = np.full(solid.shape, -1, np.int32)
        found[solid] = seen.sum(axis=0)
        return found, points

    def share(self, distance: float, size: int = 96) -> float:
        """Share of a head, 0 to 1, from profile to profile that photos show well (`ENOUGH`).

        Parameters
        ----------
        distance
            Of the views' camera from the origin, world units.
        size
            Their width and height in pixels.
        """
        views = Camera.arc(np.array(_TURNS), distance=distance, width=size, height=size,
                           focal=0.45 * size * distance)
        counted = [0, 0]
        for view in range(len(views)):
            found, points = self._seen(views, view)
            head = (found >= 0) & (points[..., 1] > self._chin)
            counted[0] += int((found[head] >= self.ENOUGH).sum())
            counted[1] += int(head.sum())
        return counted[0] / max(counted[1], 1)


def _normals(points: Float64, eye: Float64) -> Float64:
    """Normals [H, W, 3] of a picture of points, towards the eye."""
    down, across = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normal = np.nan_to_num(np.cross(down, across))
    # Lattice points leave steps where photos look along the surface.
    normal = ndimage.gaussian_filter(normal, (_SMOOTH, _SMOOTH, 0))
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    away = np.sign(((eye - points) * normal).sum(axis=-1, keepdims=True))
    return np.asarray(np.nan_to_num(normal * away), np.float64)
