"""Where a field may have matter at all: the visual hull of the mattes."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy import ndimage

from ..capture import Camera
from ..kernels.fuse import pixel_of

__all__ = ["hull_box", "visual_hull"]


@njit(cache=True, parallel=True)
def _carve(x, y, z, camera, covered, seen, against):  # type: ignore[no-untyped-def]
    """Count, for each lattice point, the view if it shows the point, and if it shows it empty."""
    height, width = covered.shape
    for k in prange(len(z)):
        for j in range(len(y)):
            for i in range(len(x)):
                row, column, _ = pixel_of(x[i], y[j], z[k], camera, height, width)
                if row >= 0:
                    seen[k, j, i] += 1
                    if not covered[row, column]:
                        against[k, j, i] += 1


def visual_hull(cameras: Camera, alphas: list[NDArray[np.uint8]], shape: tuple[int, int, int],
                center: NDArray[np.float64], radius: NDArray[np.float64],
                tolerance: float = 0.03) -> NDArray[np.bool_]:
    """Lattice points that (nearly) no matte rules out.

    Parameters
    ----------
    cameras, alphas
        Views and their mattes, uint8 [H, W].
    shape
        Lattice points along z, y, x.
    center, radius
        The box of the lattice, float64 [3] each (x, y, z).
    tolerance
        A point is carved away when more than this share of the views that have it in the picture
        show nothing within a voxel of it (mattes from a network err now and then).

    Returns
    -------
    hull
        bool [Z, Y, X]. Points that fewer than a twentieth of the pictures show are not in it:
        nothing would keep them from becoming floaters.
    """
    x, y, z = (center[i] + radius[i] * (2.0 * (np.arange(shape[2 - i]) + 0.5) / shape[2 - i] - 1.0)
               for i in range(3))
    seen, against = np.zeros(shape, np.int16), np.zeros(shape, np.int16)
    for view, alpha in enumerate(alphas):
        pose, focal = cameras.pose[view], cameras.focal[view]
        distance = float(np.linalg.norm(cameras.position[view] - center))
        voxel = 2.0 * float((radius / shape[::-1]).max()) * float(focal.max()) / distance
        covered = ndimage.maximum_filter(alpha, size=2 * int(np.ceil(voxel)) + 1) > 12
        row = np.concatenate([pose[:3].ravel(), focal, cameras.center[view]])
        _carve(x, y, z, row, covered, seen, against)
    enough = max(1, round(0.05 * len(alphas)))
    return (seen >= enough) & (against <= tolerance * seen)


def hull_box(cameras: Camera, alphas: list[NDArray[np.uint8]], reach: float = 1.8,
             ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Center and radius [3] of a box about what the mattes show, within ``reach`` of the origin.

    A head lies inside [-1, 1]^3, its shoulders need not. Points count that at least two fifths of
    the views have in the picture, so that the box does not follow the hull's tail away from the
    cameras.
    """
    center, radius = np.zeros(3), np.full(3, reach)
    size = 72
    hull = visual_hull(cameras, alphas, (size,) * 3, center, radius)
    axis = reach * (2.0 * (np.arange(size) + 0.5) / size - 1.0)
    z, y, x = np.nonzero(hull)
    if not len(z):
        return center, np.ones(3)
    points = np.stack([axis[x], axis[y], axis[z]], 1)
    pixels, depth = cameras.project(points)
    inside = ((depth > 0) & (pixels >= 0).all(-1) & (pixels[..., 0] < cameras.width[:, None])
              & (pixels[..., 1] < cameras.height[:, None]))
    points = points[inside.mean(0) >= 0.4]
    if not len(points):
        return center, np.ones(3)
    margin = 2.5 * reach / size
    low, high = points.min(0) - margin, points.max(0) + margin
    return 0.5 * (low + high), 0.5 * (high - low)
