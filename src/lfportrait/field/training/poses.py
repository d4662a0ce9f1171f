"""Refining the cameras while the field is trained.

Cameras from structure from motion are off by a pixel or more now and then. A few times in each
level every training photo is laid on the field's rendering of it, and training goes on with the
corrected cameras. What all corrections have in common - the whole set of cameras turned, moved or
scaled - is taken out, as the field would follow it and leave the held-out cameras behind.

A photo is laid on by Gauss-Newton on the photometric error (Lucas and Kanade 1981): the field knows
the depth under each pixel, so that six numbers a view, a rotation and a translation, say how its
pixels move. Every step renders again, so that occlusions are right at each pose. An object with
little relief hardly distinguishes a rotation from a translation; there a prior keeps the camera
near its given pose.
"""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from ...arrays import Array, Float32, Float64, Int64
from ...capture import Camera, Capture, pose_corrections, without_drift
from ..grid import VoxelField
from ..kernels.render import pose_equations

_DEGREES, _SHARE = 0.5, 0.01
"""How far cameras may be off: standard deviations of the prior, in degrees and as a share of the
distance. What would be four times as much is taken for a failure."""
_CORRELATED = 500.0
"""A field's errors are correlated within patches and views: so many pixels count as one independent
sample."""
_FEW = 200
_LARGEST = 200  # Pixels on a picture's longer side at most.


@dataclass(frozen=True)
class _Photo:
    """A photo at the size at which it is compared."""

    # float32 [H, W, 3 or 4]: colors, times opacity where there is a matte, which comes fourth.
    values: Float32
    camera: Camera  # The camera, one view, scaled to the picture.
    gain: Float64  # float64 [3], the photo's exposure.


def aligned(field: VoxelField, capture: Capture, given: Camera, views: Int64,
            gains: Float64, steps: int = 2) -> Camera:
    """Cameras of W views under which the field, as it is, looks more like the photos.

    One for each of ``views``, at the photos' own size; where nothing was better, as it was. The
    capture has the cameras to start from, ``given`` are those of all views before any correction,
    which hold the corrected ones; ``gains`` are float64 [W, 3], exposures, ``steps`` those of
    Gauss-Newton.
    """
    poses = [_align(field, _small(field, capture, int(view), gain), given.pose[view], steps)
             for view, gain in zip(views, gains)]
    return replace(capture.cameras[views], pose=np.array(poses).reshape(-1, 4, 4))


def _small(field: VoxelField, capture: Capture, view: int, gain: Float64) -> _Photo:
    """A photo reduced until a pixel is about a voxel."""
    camera = capture.cameras[view]
    distance = float(np.linalg.norm(camera.position[0] - field.center))
    voxel = 2.0 * float((field.radius / field.links.shape[::-1]).max())
    largest = float(max(camera.width[0], camera.height[0]))
    camera = camera.scaled(min(1.0, distance / (voxel * float(camera.focal.max())),
                               _LARGEST / largest))
    size = int(camera.width[0]), int(camera.height[0])
    photo = capture.images[view].astype(np.float32) / 255.0
    if capture.alphas is not None:
        alpha = capture.alphas[view].astype(np.float32)[..., None] / 255.0
        photo = np.concatenate([photo * alpha, alpha], axis=2)
    return _Photo(_smooth(cv2.resize(photo, size, interpolation=cv2.INTER_AREA)), camera, gain)


def _smooth(picture: Array) -> Float32:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.8))


def _beside_the_outline(depth: Float32) -> Float32:
    """Depth with that of the outline for six pixels beside it."""
    missing = ~np.isfinite(depth)
    if not missing.any() or missing.all():
        return depth
    away, label = cv2.distanceTransformWithLabels(
        missing.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    of_label = np.zeros(label.max() + 1, np.float32)
    of_label[label[~missing]] = depth[~missing]
    return np.where(away < 6.0, of_label[label], np.float32(np.inf))


@dataclass(frozen=True)
class _Comparison:
    """A photo beside the field's rendering of it."""

    # photo, values: float32 [H, W, C] both.
    photo: Float32
    values: Float32
    depth: Float32  # float32 [H, W].
    lens: tuple[float, float, float, float]  # Focal lengths and principal point.
    usual: float  # A usual difference of a pixel, robustly.

    def equations(self, usual: float) -> tuple[Float64, Float64, float, int]:
        """Matrix, right side, cost and number of pixels of a step: see `pose_equations`."""
        matrix, slope = np.zeros((6, 6)), np.zeros(6)
        cost, count = pose_equations(self.values, self.photo, self.depth, self.lens, usual, matrix,
                                     slope)
        return matrix, slope, cost, count


def _compare(field: VoxelField, photo: _Photo, pose: Float64) -> _Comparison:
    """Render the field at a pose, beside the photo."""
    camera = replace(photo.camera, pose=pose[None])
    shot = field.render(camera, 0, background=0.0, step=1.0, stop=1e-2)
    values, depth = shot.color * photo.gain.astype(np.float32), shot.depth
    if photo.values.shape[2] == 4:
        values, depth = np.dstack([values, shot.alpha]), _beside_the_outline(depth)
    values = _smooth(values)
    difference = (photo.values - values)[np.isfinite(depth)]
    sizes = np.sqrt((difference ** 2).sum(1)) if len(difference) else np.zeros(1)
    (fx, fy), (cx, cy) = camera.focal[0].tolist(), camera.center[0].tolist()
    return _Comparison(photo.values, values, np.ascontiguousarray(depth), (fx, fy, cx, cy),
                       max(1.5 * float(np.median(sizes)), 1e-3))


def _moved(pose: Float64, step: Float64) -> Float64:
    """A pose turned about and moved along its own axes."""
    moved = pose.copy()
    moved[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(step[:3]).as_matrix()
    moved[:3, 3] = pose[:3, 3] + pose[:3, :3] @ step[3:]
    return moved


def _correction(given: Float64, pose: Float64) -> Float64:
    """Six numbers: the rotation and the translation from the given pose, in its own axes."""
    turn = Rotation.from_matrix(given[:3, :3].T @ pose[:3, :3]).as_rotvec()
    return np.concatenate([turn, given[:3, :3].T @ (pose[:3, 3] - given[:3, 3])])


def _align(field: VoxelField, photo: _Photo, given: Float64, steps: int) -> Float64:
    """The pose of one photo: steps as long as its error falls."""
    pose = photo.camera.pose[0]
    far = float(np.linalg.norm(given[:3, 3] - field.center))
    spread = np.repeat([np.radians(_DEGREES), _SHARE * far], 3)
    now = _compare(field, photo, pose)
    for _ in range(steps):
        # The better the photo fits, the more it is believed.
        matrix, slope, cost, count = now.equations(now.usual)
        if count < _FEW:
            break
        variance = now.usual ** 2 * _CORRELATED
        off = _correction(given, pose)
        step = np.linalg.solve(matrix / variance + np.diag(1.0 / spread ** 2),
                               slope / variance - off / spread ** 2)
        moved = _moved(pose, step)
        if (np.abs(_correction(given, moved)) > 4.0 * spread).any():
            break
        then = _compare(field, photo, moved)
        _, _, cost_then, count = then.equations(now.usual)
        if count < _FEW or cost_then >= cost:
            break
        pose, now = moved, then
        if (np.abs(step) < 0.004 * spread).all():
            break
    return pose


_COARSE, _FINEST = (0.25, 0.5, 0.75, 1.0), (0.1, 0.25, 0.4, 0.55)
"""When cameras are corrected: shares of the rays of a coarse level, and of the finest one, the end
of which belongs to the colors."""


class PoseRefiner:
    """The cameras of a reconstruction that corrects those of its training views."""

    def __init__(self, capture: Capture, views: Int64) -> None:
        self.given, self.views, self.names = capture.cameras, views, capture.names
        self.found = self.given[views]
        self.level, self.rounds = 0, 0

    def due(self, level: int, done: float, finest: bool) -> bool:
        """Whether it is time for a correction when a share ``done`` of a level is trained."""
        if level != self.level:
            self.level, self.rounds = level, 0
        times = _FINEST if finest else _COARSE
        return self.rounds < len(times) and done >= times[self.rounds]

    def refine(self, field: VoxelField, capture: Capture, gains: Float64) -> Capture:
        """The capture with the training views' cameras corrected once more.

        ``gains`` float64 [V, 3] are the training photos' exposures.
        """
        self.rounds += 1
        found = aligned(field, capture, self.given, self.views, gains)
        self.found = without_drift(found, self.given[self.views])
        return self.placed(capture)

    def placed(self, capture: Capture) -> Capture:
        """The capture with the training views' cameras as they were found."""
        return _with_poses(capture, self.views, self.found.pose)

    def tested(self, field: VoxelField, capture: Capture, gains: Float64,
               some: Int64 | None = None) -> Capture:
        """The capture with held-out cameras laid on the field, too, which learns nothing by it.

        ``gains`` float64 [W, 3] are the held-out photos' exposures; ``some`` of them, by default
        all.
        """
        tests = capture.testing()
        if some is not None:
            tests, gains = tests[some], gains[some]
        return _with_poses(capture, tests,
                           aligned(field, capture, self.given, tests, gains, steps=8).pose)

    def figures(self) -> dict[str, Any]:
        """For ``--json``: sizes of the corrections, and the training cameras in NeRF's axes."""
        angle, share = pose_corrections(self.given[self.views], self.found)
        flip = np.diag([1.0, -1.0, -1.0, 1.0])
        return {"median_degrees": round(float(np.median(angle)), 4),
                "largest_degrees": round(float(angle.max()), 4),
                "median_share_of_distance": round(float(np.median(share)), 6),
                "largest_share_of_distance": round(float(share.max()), 6),
                "cameras": [{"name": self.names[int(view)], "transform_matrix":
                             (pose @ flip).tolist()}
                            for view, pose in zip(self.views, self.found.pose)]}

    # -- checkpoints ------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {"poses": self.found.pose, "pose_rounds": np.array([self.level, self.rounds])}

    def restore(self, state: dict[str, Any], capture: Capture) -> Capture:
        """Go on from a checkpoint; returns the capture with its cameras.

        Raises `KeyError` if the checkpoint has no cameras.
        """
        self.found = replace(self.found, pose=state["poses"])
        self.level, self.rounds = (int(count) for count in state["pose_rounds"])
        return self.placed(capture)


def _with_poses(capture: Capture, views: Int64, poses: Float64) -> Capture:
    every = capture.cameras.pose.copy()
    every[views] = poses
    return replace(capture, cameras=replace(capture.cameras, pose=every))
