"""Places of one view found in another by the field's depth, with a test of visibility."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter
from torch.nn import functional

from .photo_views import PhotoView

__all__ = ["TOLERANCE", "Correspondence", "seen_from"]

TOLERANCE = 0.02
"""A place is the same where both views' depths agree within this, in world units: a head is about
one and a half high, a nose 0.15 deep, and a voxel less than 0.01."""


@dataclass(frozen=True)
class Correspondence:
    """Where each pixel of one view lies in another.

    Attributes
    ----------
    grid
        float32 [1, h, w, 2], place (x, y) in the other view, -1 to 1 from border to border.
    visible
        bool [h, w], whether the other view sees the same place of the surface.
    cosine
        float32 [h, w], between the directions from which both see it.
    """

    grid: torch.Tensor
    visible: torch.Tensor
    cosine: NDArray[np.float32]

    def warped(self, picture: torch.Tensor) -> torch.Tensor:
        """A picture of the other view [1, C, H, W] as this view would show it, [1, C, h, w]."""
        return functional.grid_sample(picture, self.grid, mode="bilinear", padding_mode="border",
                                      align_corners=False)


def seen_from(view: PhotoView, other: PhotoView, tolerance: float = TOLERANCE,
              place: str = "cpu") -> Correspondence:
    """Where ``other`` sees what ``view`` shows, for pictures on torch's device ``place``.

    Visibility is tested by depth: the surface's point, projected into the other view, must lie as
    far away as what that view shows there, at that pixel or between it and the next ones.
    """
    height, width = view.shape
    points = np.nan_to_num(view.points.reshape(-1, 3))
    known = np.isfinite(view.points).all(-1) & view.inside
    pixels, away = other.camera.project(points)
    x, y = pixels[0].T
    rows = np.clip(np.floor(y), 0, other.shape[0] - 1).astype(int)
    columns = np.clip(np.floor(x), 0, other.shape[1] - 1).astype(int)
    within = (x > 0) & (y > 0) & (x < other.shape[1]) & (y < other.shape[0])
    nearest, farthest = _depths_around(other)
    same = ((away[0] > nearest[rows, columns] - tolerance)
            & (away[0] < farthest[rows, columns] + tolerance))
    visible = known & (within & same & other.inside[rows, columns]).reshape(height, width)
    grid = np.stack([2 * x / other.shape[1] - 1, 2 * y / other.shape[0] - 1], -1)
    grid = np.clip(grid, -2, 2).reshape(1, height, width, 2).astype(np.float32)
    return Correspondence(torch.from_numpy(grid).to(place), torch.from_numpy(visible).to(place),
                          _cosine(points, view, other).reshape(height, width))


def _depths_around(view: PhotoView) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Least and largest depth of a pixel and its eight neighbours, places without one left out."""
    known = np.isfinite(view.depth)
    return (minimum_filter(np.where(known, view.depth, np.inf), 3),
            maximum_filter(np.where(known, view.depth, -np.inf), 3))


def _cosine(points: NDArray[np.float64], view: PhotoView, other: PhotoView,
            ) -> NDArray[np.float32]:
    """Cosine of the angle at points [N, 3] between the directions to two cameras."""
    first, second = (one.camera.position[0] - points for one in (view, other))
    length = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    return ((first * second).sum(1) / np.maximum(length, 1e-12)).astype(np.float32)
