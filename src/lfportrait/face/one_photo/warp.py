"""Lay a fitted head over its photo: what the landmarks and the outline leave over.

Moved in the picture's plane alone, by a thin-plate spline; depths stay the model's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from ..head_fit import Picture, View, outline_errors, outline_vertices
from ..head_prior import EYES, HeadPrior, with_normals

__all__ = ["warped"]

Float64 = NDArray[np.float64]

OUTLINES = 110
"""Places of the outline, at most, that are moved to the matte's."""
FARTHEST = 0.2
"""They move at most this part of the distance of the eyes."""
STIFF = 0.3
"""Smoothing of the spline: landmarks that contradict their neighbours are not followed wholly."""


def warped(prior: HeadPrior, view: View, vertices: Float64, picture: Picture) -> Float64:
    """A head in the camera's frame, moved so that landmarks and outline meet.

    Parameters
    ----------
    prior, view
        The model and its pose.
    vertices
        float64 [N, 3] in the model's frame.
    picture
        The photo.

    Returns
    -------
    points
        float64 [N, 3] in the camera's frame, metres.
    """
    local = view.to_camera(vertices)
    seen = view.project(vertices)
    inner = prior.landmarks[17:]
    from_, by = [seen[inner]], [prior.vertices_seen(picture.landmarks)[17:] - seen[inner]]
    if picture.inside is not None:
        normals = with_normals(vertices, prior.triangles)
        rim = outline_vertices(view, prior, vertices, normals, neck=True)
        away, slope, hair = outline_errors(picture, seen[rim], view)
        good = (np.abs(away) < FARTHEST * picture.eyes) & ~((hair > 0.5) & (away > 0))
        rim, away, slope = rim[good], away[good], slope[good]
        chosen = _spread(seen[rim], OUTLINES)
        from_.append(seen[rim[chosen]])
        by.append(-away[chosen, None] * slope[chosen])
    middle, size = seen.mean(axis=0), float(np.ptp(seen, axis=0).max())
    corners = middle + 1.5 * size * np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)
                                              if x or y])
    from_.append(corners)
    by.append(np.zeros((8, 2)))
    at, move = np.concatenate(from_), np.concatenate(by)
    at, first = np.unique(np.round(at, 3), axis=0, return_index=True)
    spline = RBFInterpolator(at / size, move[first], kernel="thin_plate_spline",
                             smoothing=STIFF / size)
    moved = seen + spline(seen / size)
    # An eyeball stays a ball: it moves as a whole.
    for side in (vertices[:, 0] < 0, vertices[:, 0] >= 0):
        ball = (prior.part == EYES) & side
        if ball.any():
            moved[ball] = seen[ball] + (moved[ball] - seen[ball]).mean(axis=0)
    out = local.copy()
    out[:, :2] = (moved - view.center) / view.focal * local[:, 2:]
    return out


def _spread(points: Float64, most: int) -> NDArray[np.int64]:
    """Indices of up to ``most`` of points [N, 2], evenly spread: one a cell of a grid."""
    if len(points) <= most:
        return np.arange(len(points), dtype=np.int64)
    size = float(np.ptp(points, axis=0).sum()) * 2 / most
    cells = np.floor(points / max(size, 1e-9)).astype(np.int64)
    return np.asarray(np.unique(cells, axis=0, return_index=True)[1], np.int64)
