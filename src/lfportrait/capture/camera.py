"""Pinhole cameras in the OpenCV frame: x right, y down, z forward, pixel centres at +0.5.

A `Camera` is a batch of V views. Poses are camera-to-world; the world is the portrait frame
(+y up, +z out of the face). Lens distortion is undone when a capture is read, so that every stage
after `capture` sees pinholes only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bool, Float64, Int64

__all__ = ["Camera"]



@dataclass(frozen=True)
class Camera:
    """A batch of V pinhole cameras.

    Attributes
    ----------
    pose
        float64 [V, 4, 4], camera-to-world, rigid.
    focal
        float64 [V, 2], focal lengths in pixels (x, y).
    center
        float64 [V, 2], principal point in pixels (x, y); the middle of an image of width W is W/2.
    width, height
        int64 [V], picture sizes in pixels.
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

    def __len__(self) -> int:
        return len(self.pose)

    def __getitem__(self, index: int | slice | Sequence[int] | NDArray[Any]) -> Camera:
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
        view
            Index of the view.
        pixels
            [N, 2] image points (x, y); by default the pixel centres in scan order, N = H W.

        Returns
        -------
        origins, directions
            float64 [N, 3] each, in the world; directions have unit length.
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

    def project(self, points: Float64) -> tuple[Float64, Float64]:
        """Project world points into every view.

        Parameters
        ----------
        points
            [N, 3] world points.

        Returns
        -------
        pixels
            float64 [V, N, 2] image points (x, y); meaningless where the depth is not positive.
        depth
            float64 [V, N], distance along the optical axis (z in the camera frame).
        """
        offset = np.asarray(points, np.float64)[None] - self.position[:, None]
        local = np.einsum("vji,vnj->vni", self.pose[:, :3, :3], offset)
        depth = local[..., 2]
        safe = np.where(np.abs(depth) > 1e-12, depth, 1e-12)
        pixels = local[..., :2] / safe[..., None] * self.focal[:, None] + self.center[:, None]
        return pixels, depth

    def shows(self, points: Float64) -> Bool:
        """Whether each view has world points [N, 3] before it and in its picture, bool [V, N]."""
        pixels, depth = self.project(points)
        size = np.stack([self.width, self.height], axis=-1)[:, None]
        return np.asarray((depth > 0) & ((pixels >= 0) & (pixels < size)).all(axis=-1))

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
