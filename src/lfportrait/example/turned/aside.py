"""Photos of faces that are turned far to one side: landmarks and control points by a generic head.

A part of their landmarks lies behind nose, brow and cheek. In the picture these points fall onto
what hides them: a map that leads through them folds, and eye and mouth appear twice. So the pose of
the face (`lfportrait.face.face_pose`) determines which landmarks are visible. The others are moved
out to the outline, where the surface that they lie on disappears, and the guide follows what is
seen of the generic head.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from ...face import GENERIC_LANDMARKS, FacePose, face_pose, face_yaw, generic_depth
from .seen import clearness, painted_places

__all__ = ["SPACING", "FaceAside", "face_aside"]

Float64 = NDArray[np.float64]

RAMP = 10.0
"""Degrees over which a turning head's guide goes over to what is seen of the generic head."""
SPACING = 0.03
"""Distance of the grid's points, in the generic head's units."""
EVERY = 2
"""A control point every Nth of them."""
BEHIND = 0.08
"""Cosine to the camera from which on a landmark is seen."""
SLIGHT = 0.01
"""The nose's place between the eyes' corners (`face_yaw`) changes by 0.02 a degree: where it has
not changed by this for each degree of the limit, no pose is asked for."""
PLAIN = 0.2
"""The same for control points: nearer to the outline a small error is a long way on the head."""


@dataclass(frozen=True)
class FaceAside:
    """A face that is turned far to one side.

    Attributes
    ----------
    landmarks
        float64 [68, 2], pixels; those that are hidden lie on the outline.
    hidden
        bool [68].
    points
        float64 [M, 3], what is seen of the generic head, in its frame.
    places
        float64 [M, 2], where the photo shows it, pixels.
    pose
        Of the face.
    share
        How far these points replace the landmarks as control points, in (0, 1]: a head that turns
        in a video does not jump.
    """

    landmarks: Float64
    hidden: NDArray[np.bool_]
    points: Float64
    places: Float64
    pose: FacePose
    share: float

    def in_exemplar(self, landmarks: Float64) -> Float64:
        """Where an exemplar with landmarks [68, 2] has the points, [M, 2]; NaN where hidden."""
        pose = face_pose(landmarks)
        grid = _grid()
        places = painted_places(grid, landmarks, pose)
        places[clearness(grid, pose) < PLAIN / 2] = np.nan
        return _sampled(places, self.points)


def face_aside(landmarks: NDArray[np.floating], least: float) -> FaceAside | None:
    """What is seen of a face that is turned by more than ``least`` degrees, else None.

    Parameters
    ----------
    landmarks
        [68, 2] in pixels; rows with NaN are unknown.
    least
        Degrees.
    """
    found = np.asarray(landmarks, np.float64)
    # A pose takes as long as half of a small frame: most faces are seen to be frontal without it.
    if not np.isfinite(found).all() or abs(face_yaw(found)) < SLIGHT * least:
        return None
    pose = face_pose(found)
    share = min((abs(pose.yaw) - least) / RAMP, 1.0)
    if share <= 0:
        return None
    grid = _grid()
    places, clear = painted_places(grid, found, pose), clearness(grid, pose)
    hidden = _sampled(clear, GENERIC_LANDMARKS) < BEHIND
    far = np.sign(pose.yaw) * pose.rotation[:2, 0] * [1.0, -1.0]
    moved = found + share * hidden[:, None] * (_outline(places, far) - found)
    thin = slice(None, None, EVERY), slice(None, None, EVERY)
    part = (clear[thin] > PLAIN) & ((grid[thin][..., 0] / 0.42) ** 2
                                    + ((grid[thin][..., 1] + 0.06) / 0.6) ** 2 < 1)
    return FaceAside(moved, hidden, grid[thin][part], places[thin][part], pose, share)


@lru_cache(maxsize=1)
def _grid() -> Float64:
    """Points of the generic face, rows downwards, [h, w, 3]."""
    x, y = np.meshgrid(np.arange(-16, 17) * SPACING, np.arange(18, -25, -1) * SPACING)
    return np.stack([x, y, generic_depth(x, y)], axis=-1)


def _sampled(values: Float64, points: Float64) -> Float64:
    """Values of the grid [h, w(, C)] at points [M, 3] of the head."""
    grid = _grid()
    row = (grid[0, 0, 1] - points[:, 1]) / SPACING
    column = (points[:, 0] - grid[0, 0, 0]) / SPACING
    planes = values.reshape(*values.shape[:2], -1)
    found = np.stack([map_coordinates(planes[..., n], [row, column], order=1, mode="nearest")
                      for n in range(planes.shape[2])], axis=-1)
    return found.reshape(len(points), *values.shape[2:])


def _outline(places: Float64, far: Float64) -> Float64:
    """Where the surface ends in the photo at the height of each landmark, [68, 2].

    ``places`` [h, w, 2] of the grid; ``far`` is the photo's direction to the far side.
    """
    ends = np.argmax(places @ far, axis=1)
    edge = np.repeat(places[np.arange(len(ends)), ends][:, None], places.shape[1], axis=1)
    return _sampled(edge, GENERIC_LANDMARKS)
