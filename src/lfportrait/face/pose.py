"""Pose of a painted face: weak perspective, by least squares over its landmarks.

A painter's picture has no camera; far away enough for weak perspective (scale, rotation, shift) it
is. What the landmarks leave over is how the painter, or the person, differs from the generic head.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Float64
from .generic_head import GENERIC_LANDMARKS

__all__ = ["FacePose", "face_pose"]


_JAW = 0.5
"""Weight of the jaw's landmarks: on a turned face they slide along the outline."""


@dataclass(frozen=True)
class FacePose:
    """Weak perspective of a face in a picture.

    Attributes
    ----------
    rotation
        float64 [3, 3], from the portrait frame to the painter's (+x right, +y up, +z to him).
    scale
        Pixels per unit of the generic head.
    shift
        float64 [2], pixels (x, y) of the frame's origin.
    residual
        Root mean square distance in pixels of the landmarks that are left over, jaw excluded.
    """

    rotation: Float64
    scale: float
    shift: Float64
    residual: float

    @property
    def yaw(self) -> float:
        """Degrees that the face is turned to the picture's right."""
        return float(np.degrees(np.arctan2(self.rotation[0, 2], self.rotation[2, 2])))

    @property
    def pitch(self) -> float:
        """Degrees that the face looks up."""
        return float(np.degrees(np.arcsin(np.clip(self.rotation[1, 2], -1, 1))))

    @property
    def roll(self) -> float:
        """Degrees that the head leans to the picture's left."""
        return float(np.degrees(np.arctan2(self.rotation[1, 0], self.rotation[0, 0])))

    @property
    def angles(self) -> dict[str, float]:
        """Yaw, pitch and roll in degrees, rounded, for figures."""
        return {name: round(getattr(self, name), 1) for name in ("yaw", "pitch", "roll")}

    def project(self, points: Float64) -> Float64:
        """Pixels [..., 2] of points [..., 3] of the generic head."""
        seen = points @ self.rotation[:2].T
        return np.asarray(self.scale * seen * [1.0, -1.0] + self.shift, np.float64)

    def depth(self, points: Float64) -> Float64:
        """How near to the painter points [..., 3] lie, [...], in the head's units."""
        return np.asarray(points @ self.rotation[2], np.float64)


def face_pose(landmarks: NDArray[np.floating]) -> FacePose:
    """The pose of a face by its landmarks [68, 2], pixels (x right, y down); NaN rows are unknown.

    Raises
    ------
    ValueError
        If fewer than 20 are known.
    """
    # Here: they take a tenth of a second to import, and most poses are known (`Exemplar.pose`).
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    found = np.asarray(landmarks, np.float64)
    known = np.isfinite(found).all(axis=1)
    if known.sum() < 20:
        raise ValueError("a pose needs 20 landmarks at least")
    head, seen = GENERIC_LANDMARKS[known], found[known]
    weights = np.where(np.flatnonzero(known) < 17, _JAW, 1.0)
    middle, size = seen.mean(axis=0), float(seen.std())
    start = size / float(head[:, :2].std())

    def left_over(values: Float64) -> Float64:
        rotation = Rotation.from_rotvec(values[:3]).as_matrix()
        shown = start * np.exp(values[3]) * (head @ rotation[:2].T) * [1.0, -1.0]
        away = shown + middle + size * values[4:6] - seen
        return np.asarray((weights[:, None] * away).ravel() / size, np.float64)

    best = min((least_squares(left_over, np.array([0.0, yaw, 0, 0, 0, 0]), loss="soft_l1",
                              f_scale=0.1) for yaw in (-0.6, 0.0, 0.6)),
               key=lambda one: float(one.cost))
    values = best.x
    pose = FacePose(Rotation.from_rotvec(values[:3]).as_matrix(), start * float(np.exp(values[3])),
                    middle + size * values[4:6], 0.0)
    away = (pose.project(head) - seen)[np.flatnonzero(known) >= 17]
    residual = float(np.sqrt((away ** 2).sum(axis=1).mean())) if len(away) else 0.0
    return FacePose(pose.rotation, pose.scale, pose.shift, residual)
