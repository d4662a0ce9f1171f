"""The portrait frame: where a capture's world is put so that every later stage knows the head.

+y is up, +z points out of the face, the origin is the middle of the head, and the head lies inside
the cube [-1, 1]^3. With facial landmarks the frame follows from the face; without, from the
cameras: people photograph what they want to see from its front, with the camera upright.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .camera import Camera

__all__ = ["looks_normalised", "portrait_frame_from_cameras", "portrait_frame_from_landmarks"]

Float = NDArray[np.float64]

# Ratios of an adult head (Farkas 1994, NASA-STD-3000), in units of the face height from the middle
# of the eyes to the chin (menton): head height chin to crown 2.0, head depth 1.75, so that the
# head's middle lies level with the eyes and 0.72 behind the surface between them. The cube's half
# edge leaves room for hair and for the neck below the chin.
_MIDDLE_BEHIND_EYES = 0.72
_HALF_EDGE = 1.75


def focus_point(cameras: Camera) -> Float:
    """The point nearest to all optical axes in the least-squares sense, [3]."""
    forward = cameras.pose[:, :3, 2]
    across = np.eye(3) - forward[:, :, None] * forward[:, None, :]
    matrix = across.sum(0) + 1e-9 * np.eye(3)
    return np.linalg.solve(matrix, np.einsum("vij,vj->i", across, cameras.position))


def looks_normalised(cameras: Camera) -> bool:
    """Whether a data set's own frame is a portrait frame already.

    It is if the cameras, about 1.5 to 8 units away, look at a point within 0.35 of the origin, are
    upright with +y on average, and stand in front (+z) on average.
    """
    distance = np.linalg.norm(cameras.position, axis=1)
    up = -cameras.pose[:, :3, 1]
    away = cameras.position / np.maximum(distance, 1e-9)[:, None]
    # Photos may be rolled by 90 degrees; then the mean of "up" is short but must not point down.
    return bool(np.linalg.norm(focus_point(cameras)) < 0.35 and distance.min() > 1.5
                and distance.max() < 8.0 and up.mean(0)[1] > -0.2
                and abs(up.mean(0)[0]) < 0.8 and away.mean(0)[2] > 0.2)


def portrait_frame_from_cameras(cameras: Camera) -> Float:
    """Similarity [4, 4] from the cameras' world to a portrait frame guessed from the cameras.

    The origin is the point that the cameras look at; +y is their mean up; +z is the direction to
    their mean position, made perpendicular to +y. The scale puts what the nearest quarter of the
    cameras see at that point to about the cube's size: their half field of view there (the smaller
    side) becomes 1.
    """
    middle = focus_point(cameras)
    up = -cameras.pose[:, :3, 1].mean(0)
    front = cameras.position.mean(0) - middle
    if np.linalg.norm(front) < 1e-9:
        front = -cameras.pose[:, :3, 2].mean(0)
    y = up / max(float(np.linalg.norm(up)), 1e-9)
    z = front - y * (front @ y)
    if np.linalg.norm(z) < 1e-6:
        z = np.cross(cameras.pose[0, :3, 0], y)
    z /= np.linalg.norm(z)
    rotation = np.stack([np.cross(y, z), y, z])
    distance = np.linalg.norm(cameras.position - middle, axis=1)
    half = 0.5 * np.minimum(cameras.width / cameras.focal[:, 0],
                            cameras.height / cameras.focal[:, 1])
    scale = 1.0 / float(np.quantile(distance * half, 0.25))
    similarity = np.eye(4)
    similarity[:3, :3] = scale * rotation
    similarity[:3, 3] = -scale * rotation @ middle
    return similarity


def portrait_frame_from_landmarks(landmarks: Float, cameras: Camera) -> Float:
    """Similarity [4, 4] from the cameras' world to the portrait frame of a face.

    Parameters
    ----------
    landmarks
        float64 [68, 3], triangulated points in iBUG order; NaN rows are unknown.
    cameras
        Used for the sign of +z, which points towards them, and where points are missing.

    Notes
    -----
    +x runs from the eyes on the picture's left (36-41) to those on its right (42-47), +y from the
    mouth and chin to the eyes. The middle of the head lies behind the eyes by 0.72 of the distance
    from the eyes' level to the chin, and the cube's half edge is 1.75 of it (anthropometry).
    """
    def mean(first: int, last: int) -> Float:
        return np.nanmean(landmarks[first:last], axis=0)

    left, right = mean(36, 42), mean(42, 48)
    eyes = 0.5 * (left + right)
    mouth = mean(48, 60)
    x = right - left
    down = mouth - eyes
    x /= np.linalg.norm(x)
    y = -(down - x * (down @ x))
    y /= np.linalg.norm(y)
    z = np.cross(x, y)
    if z @ (cameras.position.mean(0) - eyes) < 0:
        z, x = -z, -x
    rotation = np.stack([x, y, z])
    # The mouth hangs nearer to the viewer than the eyes on most faces, which tips y; the chin and
    # the brows do not matter then. Face height from eyes and mouth: the mouth lies 0.62 down.
    height = -(down @ y) / 0.62
    if np.isfinite(landmarks[8]).all():
        height = 0.5 * height + 0.5 * float((eyes - landmarks[8]) @ y)
    middle = eyes - _MIDDLE_BEHIND_EYES * height * z
    scale = 1.0 / (_HALF_EDGE * height)
    similarity = np.eye(4)
    similarity[:3, :3] = scale * rotation
    similarity[:3, 3] = -scale * rotation @ middle
    return similarity
