"""Pinhole cameras, and the portrait frame: the coordinates of the head that all later stages use.

A `Camera` is a batch of V views in the OpenCV frame: x right, y down, z forward, pixel centres at
+0.5. Poses are camera-to-world; the world is the portrait frame. Lens distortion is undone when a
capture is read, so that every stage after `capture` sees pinholes only.

In the portrait frame +y is up, +z points out of the face, the origin is the middle of the head, and
the head lies inside the cube [-1, 1]^3. With facial landmarks the frame follows from the face;
without, from the cameras: people photograph what they want to see from its front, with the camera
upright.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, Bool, Float64, Int64


@dataclass(frozen=True)
class Camera:
    """A batch of V pinhole cameras.

    Attributes
    ----------
    pose : float64 [V, 4, 4], camera-to-world, rigid.
    focal : float64 [V, 2], focal lengths in pixels (x, y).
    center : float64 [V, 2], principal point in pixels (x, y); the middle of an image of width W
        is W/2.
    width, height : int64 [V], picture sizes in pixels.
    """

    pose: Float64
    focal: Float64
    center: Float64
    width: Int64
    height: Int64

    def __post_init__(self) -> None:
        pose = np.asarray(self.pose, np.float64)
        if pose.ndim != 3 or pose.shape[1:] != (4, 4):
            raise ValueError(f"pose must be [V, 4, 4], not {list(pose.shape)}")
        count = len(pose)
        fields: dict[str, Any] = {
            "pose": pose,
            "focal": np.broadcast_to(np.asarray(self.focal, np.float64), (count, 2)),
            "center": np.broadcast_to(np.asarray(self.center, np.float64), (count, 2)),
            "width": np.broadcast_to(np.asarray(self.width, np.int64), (count,)),
            "height": np.broadcast_to(np.asarray(self.height, np.int64), (count,)),
        }
        for name, value in fields.items():
            object.__setattr__(self, name, np.ascontiguousarray(value))

    def __repr__(self) -> str:
        sizes = sorted({*zip(self.width.tolist(), self.height.tolist())})
        shown = [f"{width} x {height}" for width, height in sizes[:3]] + ["..."] * (len(sizes) > 3)
        return f"Camera({', '.join([f'{len(self)} views', *shown])})"

    def __len__(self) -> int:
        return len(self.pose)

    def __getitem__(self, index: int | slice | Sequence[int] | Array) -> Camera:
        """Select views; an integer gives a batch of one."""
        if isinstance(index, (int, np.integer)):
            index = [int(index)]
        return Camera(self.pose[index], self.focal[index], self.center[index],
                      self.width[index], self.height[index])

    @property
    def position(self) -> Float64:
        """Camera centres in the world, float64 [V, 3]."""
        return self.pose[:, :3, 3]

    @property
    def pixel(self) -> float:
        """Size of a pixel at the origin, in world units; the median of the cameras."""
        distance = np.linalg.norm(self.position, axis=1)
        return float(np.median(distance / self.focal.mean(axis=1)))

    def scaled(self, factor: float) -> Camera:
        """The same cameras with pictures ``factor`` times as large (sizes rounded)."""
        width = np.maximum(1, np.rint(self.width * factor)).astype(np.int64)
        height = np.maximum(1, np.rint(self.height * factor)).astype(np.int64)
        ratio = np.stack([width / self.width, height / self.height], axis=1)
        return Camera(self.pose, self.focal * ratio, self.center * ratio, width, height)

    def rays(self, view: int, pixels: Float64 | None = None) -> tuple[Float64, Float64]:
        """Rays of one view.

        Parameters
        ----------
        view : Index of the view.
        pixels : [N, 2] image points (x, y); by default the pixel centres in scan order, N = H W.

        Returns
        -------
        origins, directions : float64 [N, 3] each, in the world; directions have unit length.
        """
        if pixels is None:
            x, y = np.meshgrid(np.arange(self.width[view]) + 0.5,
                               np.arange(self.height[view]) + 0.5)
            pixels = np.stack([x.ravel(), y.ravel()], axis=1)
        local = np.ones((len(pixels), 3))
        local[:, :2] = (pixels - self.center[view]) / self.focal[view]
        local /= np.linalg.norm(local, axis=1, keepdims=True)
        directions = local @ self.pose[view, :3, :3].T
        return np.broadcast_to(self.position[view], directions.shape).copy(), directions

    @property
    def rows(self) -> Float64:
        """The views as kernels take them: float64 [V, 16], pose row by row, focal, center."""
        return np.concatenate([self.pose[:, :3].reshape(-1, 12), self.focal, self.center], axis=1)

    def row(self, view: int) -> Float64:
        """One view as kernels take it (`rows`), float64 [16]."""
        return np.concatenate([self.pose[view, :3].ravel(), self.focal[view], self.center[view]])

    def project(self, points: Float64) -> tuple[Float64, Float64]:
        """Project world points into every view.

        Parameters
        ----------
        points : [N, 3] world points.

        Returns
        -------
        pixels : float64 [V, N, 2] image points (x, y); meaningless where the depth is not
            positive.
        depth : float64 [V, N], distance along the optical axis (z in the camera frame).
        """
        offset = np.asarray(points, np.float64)[None] - self.position[:, None]
        local = np.einsum("vji,vnj->vni", self.pose[:, :3, :3], offset)
        depth = local[..., 2]
        safe = np.where(np.abs(depth) > 1e-12, depth, 1e-12)
        pixels = local[..., :2] / safe[..., None] * self.focal[:, None] + self.center[:, None]
        return pixels, depth

    def shows(self, points: Float64) -> Bool:
        """Whether each view has world points [N, 3] before it and in its picture, bool [V, N]."""
        points = np.asarray(points, np.float64)
        shown = np.empty((len(self), len(points)), bool)
        for view, turn in enumerate(self.pose[:, :3, :3]):
            local = points @ turn - self.position[view] @ turn
            depth = local[:, 2]
            shown[view] = depth > 0
            for axis, size in enumerate((self.width[view], self.height[view])):
                across = local[:, axis] * self.focal[view, axis] + self.center[view, axis] * depth
                shown[view] &= (across >= 0) & (across < size * depth)
        return shown

    def transformed(self, similarity: Float64) -> Camera:
        """The cameras in another world: ``similarity`` [4, 4] maps old world points to new ones."""
        scale = np.cbrt(np.linalg.det(similarity[:3, :3]))
        pose = similarity @ self.pose
        pose[:, :3, :3] /= scale
        return Camera(pose, self.focal, self.center, self.width, self.height)

    @staticmethod
    def concatenate(cameras: Sequence[Camera]) -> Camera:
        """One batch out of several."""
        return Camera(*(np.concatenate([getattr(camera, name) for camera in cameras])
                        for name in ("pose", "focal", "center", "width", "height")))

    @staticmethod
    def look_at(positions: Float64, target: Float64, *, width: int, height: int, focal: float,
                up: Sequence[float] = (0.0, 1.0, 0.0)) -> Camera:
        """Cameras at ``positions`` [V, 3] that look at ``target`` [3], pictures upright."""
        positions = np.atleast_2d(np.asarray(positions, np.float64))
        forward = np.asarray(target, np.float64) - positions
        forward /= np.linalg.norm(forward, axis=1, keepdims=True)
        right = np.cross(forward, np.asarray(up, np.float64))
        right /= np.linalg.norm(right, axis=1, keepdims=True)
        down = np.cross(forward, right)
        pose = np.zeros((len(positions), 4, 4))
        pose[:, :3, 0], pose[:, :3, 1], pose[:, :3, 2] = right, down, forward
        pose[:, :3, 3], pose[:, 3, 3] = positions, 1.0
        return Camera(pose, np.array([focal, focal]), np.array([width / 2, height / 2]),
                      np.asarray(width), np.asarray(height))

    @staticmethod
    def arc(degrees: Float64, *, distance: float, width: int, height: int, focal: float,
            target: Sequence[float] = (0.0, 0.0, 0.0), pitch: float = 0.0) -> Camera:
        """Cameras on a horizontal arc about ``target``.

        0 degrees is frontal (on +z), positive towards +x; ``pitch`` in degrees raises them.
        """
        yaw = np.radians(np.atleast_1d(np.asarray(degrees, np.float64)))
        tilt = np.radians(pitch)
        away = np.stack([np.sin(yaw) * np.cos(tilt), np.full_like(yaw, np.sin(tilt)),
                         np.cos(yaw) * np.cos(tilt)], axis=1)
        middle = np.asarray(target, np.float64)
        return Camera.look_at(middle + distance * away, middle, width=width, height=height,
                              focal=focal)


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


def laid_over(source: Float64, target: Float64) -> tuple[float, Float64, Float64]:
    """The similarity of least squares between points [N, 3] (Umeyama 1991).

    Its scale and rotation, and the middle of the source, which it moves to that of the target.
    """
    mean = source.mean(0)
    spread, wanted = source - mean, target - target.mean(0)
    u, values, vt = np.linalg.svd(wanted.T @ spread)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = float((values * signs).sum() / (spread**2).sum())
    return scale, (u * signs) @ vt, mean


def portrait_frame_from_landmarks(landmarks: Float64, cameras: Camera) -> Float64:
    """Similarity [4, 4] from the cameras' world to the portrait frame of a face.

    By its landmarks, float64 [68, 3] in iBUG order, NaN where unknown; where too little is known,
    by the cameras (`portrait_frame_from_cameras`). A mean adult face (eyes, brows, nose, mouth,
    chin) is laid over the landmarks by the least-squares similarity. Its unit is the height h from
    the eyes to the chin; the origin lies 0.72 h behind the eyes, and the cube's half edge is 1.8 h,
    so that chin (1.0 h down), crown (1.0 h up), back of the head and hair lie inside.
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
    scale, rotation, mean = laid_over(source, target)
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
    """How far two batches of V cameras are apart, float64 [V] each.

    The angle between them in degrees, and the distance between their centres as a share of that to
    the origin.
    """
    from scipy.spatial.transform import Rotation  # a tenth of a second that few commands need

    turn = np.einsum("vji,vjk->vik", given.pose[:, :3, :3], found.pose[:, :3, :3])
    away = np.linalg.norm(given.position, axis=1)
    return (np.degrees(Rotation.from_matrix(turn).magnitude()),
            np.linalg.norm(found.position - given.position, axis=1) / away)
