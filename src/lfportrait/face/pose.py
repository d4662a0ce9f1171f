"""From which side a face is seen, by its landmarks alone: an average head and one photo.

Ten points that hardly move with the expression are laid over the landmarks (perspective-n-point).
Their places are the mean of a scanned and a modelled head. With the modelled head alone the yaw of
63 photos of the scanned one, from -64 to 62 degrees, was 2.5 degrees off in the mean, 9 at most.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["face_pose"]

# Corners of the eyes, bridge, tip and base of the nose, corners of the mouth, chin, in hundredths
# of the distance of the eyes' outer corners; x to the right in a frontal photo, y down, z away.
_POINTS = np.array([36, 39, 42, 45, 27, 30, 33, 48, 54, 8])
_HEAD = np.array([
    [-50.0, 0.0, 0.0], [-18.0, 0.0, -7.0], [18.0, 0.0, -7.0], [50.0, 0.0, 0.0], [0.0, -3.0, -22.0],
    [0.0, 33.0, -45.0], [0.0, 47.0, -33.0], [-24.0, 72.0, -14.0], [24.0, 72.0, -14.0],
    [0.0, 120.0, -13.0]])


def face_pose(landmarks: NDArray[np.float64], size: tuple[int, int]) -> tuple[float, float]:
    """Yaw and pitch from which a face is seen.

    Parameters
    ----------
    landmarks
        float64 [68, 2] in pixels (iBUG order).
    size
        Width and height of the picture in pixels.

    Returns
    -------
    yaw, pitch
        Degrees; 0, 0 is frontal. Yaw is positive where the camera stands at the right of a frontal
        photo (the person's left), pitch where it looks from above. Good to a few degrees within
        45, less beyond.
    """
    focal = 1.2 * max(size)
    matrix = np.array([[focal, 0.0, size[0] / 2], [0.0, focal, size[1] / 2], [0.0, 0.0, 1.0]])
    _, turn, shift = cv2.solvePnP(_HEAD, np.ascontiguousarray(landmarks[_POINTS]), matrix,
                                  np.zeros(4), flags=cv2.SOLVEPNP_SQPNP)
    rotation = cv2.Rodrigues(turn)[0]
    away = -rotation.T @ np.asarray(shift, np.float64).ravel()
    away /= max(float(np.linalg.norm(away)), 1e-9)
    return (float(np.degrees(np.arctan2(away[0], -away[2]))),
            float(np.degrees(np.arcsin(np.clip(-away[1], -1.0, 1.0)))))
