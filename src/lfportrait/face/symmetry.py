"""3D landmarks of a face from one picture, by its symmetry.

Seen from one side, left and right are two views of one half of a face. Each pair of mirrored
landmarks has four numbers in the picture and three in space, so the pair determines the person's
proportions and, where the face is turned enough, its depth. The generic head's depth holds what the
picture leaves open.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Float64
from .generic_head import GENERIC_LANDMARKS, MIRRORED
from .pose import FacePose

__all__ = ["symmetric_landmarks"]


JAW = 17
"""The first landmarks are the jaw's."""
HELD = 0.1
"""How inexact landmarks are in the picture, over how far a face's depth is from the generic
head's."""


def symmetric_landmarks(landmarks: NDArray[np.floating], pose: FacePose) -> Float64:
    """Landmarks in space, mirror-symmetric, in the frame of the generic head; float64 [68, 3].

    Parameters
    ----------
    landmarks
        [68, 2] in pixels; rows with NaN are unknown. Those that are unknown on both sides are the
        generic head's.
    pose
        Of the face (`face_pose`).
    """
    seen = (np.asarray(landmarks, np.float64) - pose.shift) / pose.scale * [1.0, -1.0]
    known = np.isfinite(seen).all(axis=1)
    # On the far side the jaw's landmarks slide along the outline.
    far = GENERIC_LANDMARKS[:, 0] * np.sign(pose.rotation[2, 0]) < 0
    known &= ~(far & (np.arange(68) < JAW))
    out = GENERIC_LANDMARKS.copy()
    for one, other in enumerate(MIRRORED):
        sides = [(n, side) for n, side in ((one, 1.0), (other, -1.0)) if known[n]]
        if not sides:
            continue
        rows = [pose.rotation[:2] * [side, 1.0, 1.0] for _, side in sides]
        values = [seen[n] for n, _ in sides]
        rows.append(np.array([[0.0, 0.0, HELD]]))
        values.append(np.array([HELD * GENERIC_LANDMARKS[one, 2]]))
        # What is its own mirror image lies in the middle.
        free = slice(1, None) if one == other else slice(None)
        point = np.linalg.lstsq(np.concatenate(rows)[:, free], np.concatenate(values), rcond=None)
        out[one] = 0.0
        out[one, free] = point[0]
    return out
