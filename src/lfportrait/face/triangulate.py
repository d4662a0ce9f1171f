"""3D landmarks: detected in a few photos, triangulated once, used in all views.

Detectors fail towards the profile; a point triangulated from the frontal views can be projected
into any. Each point is found by robust least squares: a linear solution, then Gauss-Newton on the
pixel errors with Cauchy weights, so that single wrong detections lose their say.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import Bool, Float64, Int64
from ..capture import Camera, Capture, focus_point
from ..progress import Progress, note
from .detect import detect_landmarks, face_yaw
from .segmentation import quarter_turns

_SPREAD = 24  # Views tried first, spread over the capture.
_WANTED = 20  # Views about the front of the face that are searched.
_ENOUGH = 3  # Views with a face that landmarks in space are found from, at least.
_MOST_TURNED = 0.9  # `face_yaw` beyond which a view says little about the hidden half of the face.


def _across(cameras: Camera, points: Float64) -> tuple[Float64, Float64]:
    """What the viewing rays of one landmark say of its place x: A x = b, [V, 3, 3] and [V, 3].

    The point nearest to some of the rays solves the sum of theirs.
    """
    local = np.column_stack([(points - cameras.center) / cameras.focal, np.ones(len(points))])
    directions = np.einsum("vij,vj->vi", cameras.pose[:, :3, :3], local)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.eye(3) - directions[:, :, None] * directions[:, None]
    return across, np.einsum("vij,vj->vi", across, cameras.position)


def _refine(cameras: Camera, points: Float64, start: Float64,
            scale: float) -> tuple[Float64, Float64]:
    """Gauss-Newton on pixel errors with Cauchy weights; returns the point and its errors [V]."""
    guess = start
    rotation = cameras.pose[:, :3, :3]
    for _ in range(15):
        local = np.einsum("vji,vj->vi", rotation, guess - cameras.position)
        depth = np.maximum(local[:, 2:3], 1e-6)
        error = local[:, :2] / depth * cameras.focal + cameras.center - points
        length = np.linalg.norm(error, axis=1)
        weight = 1.0 / (1.0 + (length / scale) ** 2)
        jacobian = np.zeros((len(points), 2, 3))
        jacobian[:, 0, 0], jacobian[:, 1, 1] = 1.0, 1.0
        jacobian[:, :, 2] = -local[:, :2] / depth
        jacobian *= (cameras.focal / depth)[:, :, None]
        jacobian = np.einsum("vij,vkj->vik", jacobian, rotation)
        normal = np.einsum("v,vij,vik->jk", weight, jacobian, jacobian)
        change = np.linalg.solve(normal + 1e-9 * np.trace(normal) * np.eye(3),
                                 -np.einsum("v,vij,vi->j", weight, jacobian, error))
        guess = guess + change
        if np.linalg.norm(change) < 1e-9:
            break
    pixels, depth = cameras.project(guess[None])
    errors = np.linalg.norm(pixels[:, 0] - points, axis=1)
    errors[depth[:, 0] <= 0] = np.inf
    return guess, errors


def triangulate(cameras: Camera, points: Float64, *, tolerance: float | None = None,
                ) -> tuple[Float64, Float64, Bool]:
    """Triangulate landmarks from several views, robustly.

    Parameters
    ----------
    cameras : V views.
    points : float64 [V, N, 2], pixels (x, y); NaN where a landmark was not seen.
    tolerance : Error in pixels beyond which an observation is an outlier; by default 1 % of the
        picture's larger side, at least 2.

    Returns
    -------
    points3d : float64 [N, 3] in the world; NaN where fewer than two views agree.
    errors : float64 [N], root mean squared error of the inliers in pixels; NaN likewise.
    inliers : bool [V, N].
    """
    if points.ndim != 3 or points.shape[0] != len(cameras) or points.shape[2] != 2:
        raise ValueError(f"points must be [{len(cameras)}, N, 2], not {list(points.shape)}")
    if tolerance is None:
        tolerance = max(2.0, 0.01 * float(max(cameras.width.max(), cameras.height.max())))
    count = points.shape[1]
    found = np.full((count, 3), np.nan)
    errors = np.full(count, np.nan)
    inliers = np.zeros(points.shape[:2], bool)
    for index in range(count):
        views = np.flatnonzero(np.isfinite(points[:, index]).all(axis=1))
        if len(views) < 2:
            continue
        best = _best_start(cameras, points[:, index], views, tolerance)
        point, error = _refine(cameras[views], points[views, index], best, tolerance / 2)
        good = error < tolerance
        if good.sum() < 2:
            continue
        point, error = _refine(cameras[views[good]], points[views[good], index], point,
                               tolerance / 2)
        found[index] = point
        errors[index] = float(np.sqrt(np.mean(error ** 2)))
        inliers[views[good], index] = True
    return found, errors, inliers


def _best_start(cameras: Camera, points: Float64, views: Int64, tolerance: float) -> Float64:
    """The linear solution, from all views or from the pair that most others agree with."""
    across, along = _across(cameras[views], points[views])
    left, right = across.sum(0)[None], along.sum(0)[None]
    if len(views) > 2:
        one, other = np.triu_indices(min(len(views), 12), 1)
        left = np.concatenate([left, across[one] + across[other]])
        right = np.concatenate([right, along[one] + along[other]])
    candidates = np.linalg.solve(left + 1e-12 * np.eye(3), right[..., None])[..., 0]
    pixels, depth = cameras[views].project(candidates)
    error = np.linalg.norm(pixels - points[views][:, None], axis=-1)
    error[depth <= 0] = np.inf
    cost = np.minimum(error, 3 * tolerance).sum(axis=0)
    return np.asarray(candidates[int(cost.argmin())])


def frontal_order(cameras: Camera) -> Int64:
    """Views, int64 [V], sorted by how far they are turned from the portrait frame's front (+z)."""
    away = cameras.position
    yaw = np.abs(np.arctan2(away[:, 0], away[:, 2]))
    pitch = np.abs(np.arctan2(away[:, 1], np.hypot(away[:, 0], away[:, 2])))
    return np.argsort(yaw + 0.5 * pitch, kind="stable")


def _detect(capture: Capture, view: int, thorough: bool) -> Float64 | None:
    """Landmarks of one view; the picture is turned upright, a matted one put on grey."""
    image = np.round(255 * capture.image_float(view, background=0.6)).astype(np.uint8)
    up = capture.cameras.pose[view, :3, :3].T @ np.array([0.0, 1.0, 0.0])
    return detect_landmarks(image, turns=(quarter_turns(up),), thorough=thorough)


def _look_around(capture: Capture, progress: Progress | None) -> dict[int, Float64]:
    """Landmarks by view: views spread over the capture first, then those about the best of them.

    The portrait frame may be a guess by the cameras alone, so where the face looks is learnt from
    the detections: the views in which it shows most frontally, and their neighbours.
    """
    order = frontal_order(capture.cameras)
    detected: dict[int, Float64] = {}
    tried: set[tuple[int, bool]] = set()

    def look(views: Int64, thorough: bool = False) -> None:
        for view in (int(v) for v in views):
            if (view, thorough) in tried or view in detected:
                continue
            tried.add((view, thorough))
            note(progress, f"looking for the face: {len(detected)} views found")
            points = _detect(capture, view, thorough)
            if points is not None:
                detected[view] = points

    look(order[::max(1, len(order) // _SPREAD)])
    if not detected:
        look(order[:_SPREAD])
    # Small faces, sculptures and shaded ones are overlooked at a first look.
    thorough = len(detected) < _ENOUGH
    if thorough:
        look(order[:_SPREAD], thorough)
    if not detected:
        return detected
    away = capture.cameras.position - focus_point(capture.cameras)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    for _ in range(2):
        yaws = np.array([abs(face_yaw(points)) for points in detected.values()])
        best = np.array(list(detected))[np.argsort(yaws, kind="stable")[:3]]
        front = np.median(away[best], axis=0)
        near = np.argsort(-(away @ front), kind="stable")
        look(near[:_WANTED], thorough)
    return detected


def landmarks_of_capture(capture: Capture, progress: Progress | None = None,
                         ) -> tuple[Float64 | None, dict[str, Any]]:
    """Find the face in a capture: landmarks detected in frontal views and triangulated.

    They are float64 [68, 3] in the world, or None if fewer than three views show a face; figures
    are ``views`` (with a face), ``error_px`` (median), ``outliers`` (share). A few views from all
    around are tried first, then those nearest to where the face shows most frontally.
    Points of the jaw (0-16), which detectors let slide along the outline of a turned face, are
    taken from views that show the face nearly frontally.
    """
    detected = _look_around(capture, progress)
    detected = {view: points for view, points in detected.items()
                if abs(face_yaw(points)) < _MOST_TURNED}
    if len(detected) < _ENOUGH:
        return None, {"views": len(detected)}
    views = np.array(sorted(detected))
    observed = np.stack([detected[view] for view in views])
    yaws = np.array([abs(face_yaw(points)) for points in observed])
    turned = yaws > max(0.3, float(np.sort(yaws)[min(3, len(yaws) - 1)]))
    jaw = observed[:, :17].copy()
    jaw[turned] = np.nan
    usable = np.concatenate([jaw, observed[:, 17:]], axis=1)
    cameras = capture.cameras[views]
    eye = float(np.median(np.linalg.norm(observed[:, 36] - observed[:, 45], axis=1)))
    found, errors, inliers = triangulate(cameras, usable, tolerance=max(2.0, 0.12 * eye))
    if np.isnan(found[17:]).any():
        return None, {"views": len(views), "error_px": float(np.nanmedian(errors))}
    missing = np.asarray(np.isnan(found[:17]).any(axis=1))
    if missing.any():
        found = _fill_jaw(found, missing)
    seen = np.isfinite(usable).all(-1)
    return found, {"views": len(views), "error_px": float(np.nanmedian(errors)),
                   "outliers": float(1.0 - inliers[seen].mean())}


def _fill_jaw(points: Float64, missing: Bool) -> Float64:
    """Missing jaw points from their mirror images in the face's plane of symmetry."""
    left, right = points[[36, 39]].mean(0), points[[42, 45]].mean(0)
    normal = (right - left) / np.linalg.norm(right - left)
    middle = points[[27, 28, 29, 30, 33, 51, 57]].mean(0)
    filled = points.copy()
    for index in np.flatnonzero(missing):
        mirror = points[16 - index]
        if np.isfinite(mirror).all():
            filled[index] = mirror - 2 * ((mirror - middle) @ normal) * normal
    return filled
