"""The visual hull of the mattes: where a field can have density."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ...capture import Camera
from ...simd.decorators import lean_kernel
from ...simd.threads import shared
from ..kernels.depth_votes import pixel_of

__all__ = ["hull_box", "ruled_out", "visual_hull"]


@shared("z")
@lean_kernel
def _carve(since, until, x, y, z, camera, covered,  # type: ignore[no-untyped-def]
           asked, seen, against):
    """Count, for each point asked about, the view if it shows it, and if it shows it empty."""
    height, width = covered.shape
    for k in range(since, until):
        for j in range(len(y)):
            for i in range(len(x)):
                if not asked[k, j, i]:
                    continue
                row, column, _ = pixel_of(x[i], y[j], z[k], camera, height, width)
                if row >= 0:
                    seen[k, j, i] += 1
                    if not covered[row, column]:
                        against[k, j, i] += 1


def _votes(cameras: Camera, alphas: Sequence[NDArray[np.uint8]], asked: NDArray[np.bool_],
           center: NDArray[np.float64], radius: NDArray[np.float64], wide: bool,
           ) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """How many views have each of the lattice points ``asked`` in the picture, and show it empty.

    Empty are pixels with nothing in their mattes within a voxel (``wide``), or not a quarter of
    the light within half a voxel.
    """
    shape = asked.shape
    x, y, z = (center[i] + radius[i] * (2.0 * (np.arange(shape[2 - i]) + 0.5) / shape[2 - i] - 1.0)
               for i in range(3))
    seen, against = np.zeros(shape, np.int16), np.zeros(shape, np.int16)
    for view, alpha in enumerate(alphas):
        pose, focal = cameras.pose[view], cameras.focal[view]
        distance = float(np.linalg.norm(cameras.position[view] - center))
        voxel = 2.0 * float((radius / shape[::-1]).max()) * float(focal.max()) / distance
        reach, least = (int(np.ceil(voxel)), 12) if wide else (round(0.5 * voxel), 63)
        covered = cv2.dilate(alpha, np.ones((2 * reach + 1,) * 2, np.uint8)) > least
        row = np.concatenate([pose[:3].ravel(), focal, cameras.center[view]])
        _carve(x, y, z, row, covered, asked, seen, against)
    return seen, against


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
    return _hull(*_votes(cameras, alphas, np.ones(shape, bool), center, radius, wide=True),
                 len(alphas), tolerance)


def _hull(seen: NDArray[np.int16], against: NDArray[np.int16], views: int,
          tolerance: float = 0.03) -> NDArray[np.bool_]:
    """The hull that so many views' votes give."""
    return (seen >= max(1, round(0.05 * views))) & (against <= tolerance * seen)


def ruled_out(cameras: Camera, alphas: Sequence[NDArray[np.uint8]], filled: NDArray[np.bool_],
              center: NDArray[np.float64], radius: NDArray[np.float64],
              tolerance: float = 0.08, seldom: float = 0.2,
              ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Points of a fine lattice that mattes rule out, though the hull on a coarse one held them.

    Crumbs about an outline come from mattes that are a pixel too wide here and there; most other
    views that look past the outline at that place show nothing.

    Parameters
    ----------
    cameras, alphas
        Views and their mattes, uint8 [H, W].
    filled
        bool [Z, Y, X], the points in question.
    center, radius
        The box of the lattice, float64 [3] each (x, y, z).
    tolerance
        A point is ruled out when more than this share of the views that have it in the picture
        show less than a quarter of the light covered within half a voxel of it.
    seldom
        Share of the views.

    Returns
    -------
    ruled_out, hardly_shown
        bool [Z, Y, X]; points that fewer views than ``seldom`` have in the picture.
    """
    seen, against = _votes(cameras, alphas, filled, center, radius, wide=False)
    wrong, hardly = np.zeros(filled.shape, bool), np.zeros(filled.shape, bool)
    seen, against = seen[filled], against[filled]
    wrong[filled], hardly[filled] = against > tolerance * seen, seen < seldom * len(alphas)
    return wrong, hardly


def hull_box(cameras: Camera, alphas: list[NDArray[np.uint8]], reach: float = 1.8,
             ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Center and radius [3] of a box about what the mattes show, within ``reach`` of the origin.

    A head lies inside [-1, 1]^3, its shoulders need not. Points count that at least two fifths of
    the views have in the picture, so that the box does not follow the hull's tail away from the
    cameras.
    """
    center, radius = np.zeros(3), np.full(3, reach)
    size = 72
    seen, against = _votes(cameras, alphas, np.ones((size,) * 3, bool), center, radius, wide=True)
    hull = _hull(seen, against, len(alphas))
    axis = reach * (2.0 * (np.arange(size) + 0.5) / size - 1.0)
    z, y, x = np.nonzero(hull)
    if not len(z):
        return center, np.ones(3)
    points = np.stack([axis[x], axis[y], axis[z]], 1)
    points = points[seen[hull] >= 0.4 * len(alphas)]
    if not len(points):
        return center, np.ones(3)
    margin = 2.5 * reach / size
    low, high = points.min(0) - margin, points.max(0) + margin
    return 0.5 * (low + high), 0.5 * (high - low)
