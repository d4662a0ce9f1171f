"""The portrait frame: the coordinates of the head that all later stages use.

+y is up, +z points out of the face, the origin is the middle of the head, and the head lies inside
the cube [-1, 1]^3. With facial landmarks the frame follows from the face; without, from the
cameras: people photograph what they want to see from its front, with the camera upright.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Float64
from .camera import Camera

__all__ = ["looks_normalised", "portrait_frame_from_cameras", "portrait_frame_from_landmarks",
           "pose_corrections", "without_drift"]


# Where points of an adult face lie from the middle between the eyes (x to the picture's right, y
# up, z out of the face), in units of the height from there to the chin's lower end, about 115 mm:
# means of head scans, in keeping with the tables of Farkas (1994). Eyes lie deep, lips and chin
# stand forward, so that "down" in a face is not the line from the eyes to the mouth.
_ANCHORS: tuple[tuple[range, tuple[float, float, float]], ...] = (
    (range(36, 42), (-0.285, 0.0, 0.0)), (range(42, 48), (0.285, 0.0, 0.0)),  # eyes
    (range(17, 22), (-0.34, 0.20, 0.02)), (range(22, 27), (0.34, 0.20, 0.02)),  # brows
    (range(27, 28), (0.0, 0.04, 0.135)), (range(30, 31), (0.0, -0.265, 0.345)),  # nose: root, tip
    (range(33, 34), (0.0, -0.38, 0.25)),  # under the nose
    (range(48, 60), (0.0, -0.595, 0.18)), (range(8, 9), (0.0, -1.0, 0.14)),  # mouth, chin
)
# Head height (chin to crown) is 2.0 and depth 1.75 of that unit, so the head's middle lies level
# with the eyes and this far behind them.
_MIDDLE_BEHIND_EYES = 0.72
# Half edge of the cube: the crown is 1.0 above the eyes; hair takes up to half as much again.
_HALF_EDGE = 1.8


def focus_point(cameras: Camera) -> Float64:
    """The point nearest to all optical axes in the least-squares sense, [3]."""
    forward = cameras.pose[:, :3, 2]
    across = np.eye(3) - forward[:, :, None] * forward[:, None, :]
    matrix = across.sum(0) + 1e-9 * np.eye(3)
    return np.linalg.solve(matrix, np.einsum("vij,vj->i", across, cameras.position))


def mean_up(cameras: Camera) -> Float64:
    """The cameras' common up direction, [3], not of unit length.

    A photo may be turned by quarters: where the pictures' own "up" cancel out, each camera counts
    with that one of its four sides that agrees best with the others.
    """
    sides = np.stack([-cameras.pose[:, :3, 1], cameras.pose[:, :3, 1],
                      cameras.pose[:, :3, 0], -cameras.pose[:, :3, 0]], axis=1)
    up: Float64 = sides[:, 0].mean(0)
    if np.linalg.norm(up) < 0.6:
        for _ in range(10):
            best = np.argmax(sides @ up, axis=1)
            up = sides[np.arange(len(sides)), best].mean(0)
    return up


def looks_normalised(cameras: Camera) -> bool:
    """Whether a data set's own frame is a portrait frame already, and is kept.

    It is if the cameras, 1.2 to 8 units away, look at a point within 0.35 of the origin, are
    upright with +y on average, and stand in front (+z) on average or all around.
    """
    distance = np.linalg.norm(cameras.position, axis=1)
    if not (np.linalg.norm(focus_point(cameras)) < 0.35 and distance.min() > 1.2
            and distance.max() < 8.0):
        return False
    up = -cameras.pose[:, :3, 1].mean(0)
    length = float(np.linalg.norm(up))
    # Where photos are rolled the mean of "up" is short and says little; it must not point down.
    upright = up[1] > 0.8 * length if length > 0.5 else up[1] > -0.2
    away = (cameras.position / distance[:, None]).mean(0)
    return bool(upright and (away[2] > 0.2 or np.hypot(away[0], away[2]) < 0.25))


def portrait_frame_from_cameras(cameras: Camera, box: Float64 | None = None) -> Float64:
    """Similarity [4, 4] from the cameras' world to a portrait frame guessed from the cameras.

    The origin is the point that the cameras look at (nearest to all optical axes); +y is their mean
    up; +z is the direction to their mean position, made perpendicular to +y. The scale puts what
    the nearest quarter of the cameras see at that point to about the cube's size: their half field
    of view there (the smaller side) becomes 1.

    Where the subject's ``box`` is known, float64 [2, 3] in the cameras' world, its middle is the
    origin instead, and its longest half edge with a tenth of margin becomes 1.
    """
    middle = focus_point(cameras) if box is None else np.asarray(box.mean(0))
    up = mean_up(cameras)
    front = cameras.position.mean(0) - middle
    if np.linalg.norm(front) < 1e-9:
        front = -cameras.pose[:, :3, 2].mean(0)
    y = up / max(float(np.linalg.norm(up)), 1e-9)
    z = front - y * (front @ y)
    if np.linalg.norm(z) < 1e-6 * np.linalg.norm(front):
        z = np.cross(cameras.pose[0, :3, 0], y)
    z /= np.linalg.norm(z)
    rotation = np.stack([np.cross(y, z), y, z])
    if box is not None:
        return _similarity(1.0 / (1.1 * 0.5 * float((box[1] - box[0]).max())), rotation, middle)
    distance = np.linalg.norm(cameras.position - middle, axis=1)
    half = 0.5 * np.minimum(cameras.width / cameras.focal[:, 0],
                            cameras.height / cameras.focal[:, 1])
    return _similarity(1.0 / float(np.quantile(distance * half, 0.25)), rotation, middle)


def _similarity(scale: float, rotation: Float64, middle: Float64) -> Float64:
    """The map x -> scale rotation (x - middle) as [4, 4]."""
    similarity = np.eye(4)
    similarity[:3, :3] = scale * rotation
    similarity[:3, 3] = -scale * rotation @ middle
    return similarity


def _fit(source: Float64, target: Float64) -> tuple[float, Float64, Float64]:
    """Scale, rotation and source mean of the least-squares similarity (Umeyama 1991)."""
    mean = source.mean(0)
    spread, wanted = source - mean, target - target.mean(0)
    u, values, vt = np.linalg.svd(wanted.T @ spread)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = float((values * signs).sum() / (spread**2).sum())
    return scale, (u * signs) @ vt, mean


def portrait_frame_from_landmarks(landmarks: Float64, cameras: Camera) -> Float64:
    """Similarity [4, 4] from the cameras' world to the portrait frame of a face.

    Parameters
    ----------
    landmarks
        float64 [68, 3], triangulated points in iBUG order; NaN rows are unknown.
    cameras
        Decide instead (`portrait_frame_from_cameras`) where too little of the face is known.

    Notes
    -----
    A mean adult face (eyes, brows, nose, mouth, chin) is laid over the landmarks by the
    least-squares similarity. Its unit is the height h from the eyes to the chin; the origin lies
    0.72 h behind the eyes, and the cube's half edge is 1.8 h, so that chin (1.0 h down), crown
    (1.0 h up), back of the head and hair lie inside.
    """
    known, wanted = [], []
    for indices, place in _ANCHORS:
        points = landmarks[list(indices)]
        points = points[np.isfinite(points).all(axis=1)]
        if len(points):
            known.append(points.mean(0))
            wanted.append(place)
    source, target = np.array(known).reshape(-1, 3), np.array(wanted).reshape(-1, 3)
    if len(source) < 4:
        return portrait_frame_from_cameras(cameras)
    scale, rotation, mean = _fit(source, target)
    # Where the portrait frame's origin, behind the eyes of the mean face, lies in the source.
    origin = np.array([0.0, 0.0, -_MIDDLE_BEHIND_EYES]) - target.mean(0)
    return _similarity(scale / _HALF_EDGE, rotation, mean + rotation.T @ origin / scale)


def without_drift(found: Camera, given: Camera) -> Camera:
    """The cameras under the similarity that brings them nearest to the given ones.

    Each camera counts by its centre and, as pictures determine this better, by what it looks at:
    three points as far away as the origin (least squares, Umeyama 1991).
    """
    far = np.linalg.norm(given.position, axis=1)
    target, scale = _looked_at(given, far), 1.0
    goal = target.mean(0)
    similarity = np.eye(4)
    for _ in range(20):  # in a world of another scale the points are farther away, too
        source = _looked_at(found, far / scale)
        middle = source.mean(0)
        u, sizes, vt = np.linalg.svd((target - goal).T @ (source - middle))
        sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
        scale = float((sizes * sign).sum() / ((source - middle) ** 2).sum())
        similarity[:3, :3] = scale * (u * sign) @ vt
        similarity[:3, 3] = goal - similarity[:3, :3] @ middle
    return found.transformed(similarity)


def _looked_at(cameras: Camera, far: Float64) -> Float64:
    """Centres, the points ``far`` before them, and two beside those: [4 V, 3]."""
    x, y, z = (far[:, None] * cameras.pose[:, :3, axis] for axis in range(3))
    seen = cameras.position + z
    return np.concatenate([cameras.position, seen, seen + 0.3 * x, seen + 0.3 * y])


def pose_corrections(given: Camera, found: Camera) -> tuple[Float64, Float64]:
    """How far two batches of V cameras are apart.

    Returns
    -------
    degrees, shares
        float64 [V] each: the angle between them, and the distance between their centres as a share
        of that to the origin.
    """
    from scipy.spatial.transform import Rotation  # a tenth of a second that few commands need

    turn = np.einsum("vji,vjk->vik", given.pose[:, :3, :3], found.pose[:, :3, :3])
    away = np.linalg.norm(given.position, axis=1)
    return (np.degrees(Rotation.from_matrix(turn).magnitude()),
            np.linalg.norm(found.position - given.position, axis=1) / away)
