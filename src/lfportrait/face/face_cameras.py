"""Cameras from the face alone, for photos without a common background.

A few photos of one person, each before another background, or from sides too far apart, give
structure from motion nothing to hold on to: features of skin are few, and those of what stands
behind belong to other places. But the landmarks of a face are the same points in every photo. Each
photo's pose begins with the generic head; then poses, the lenses' focal lengths and the person's
own landmarks are found together (bundle adjustment, robust, the generic head as a weak prior).
These cameras are good to some degrees, which is enough to know where the head is in each photo;
features of the head alone, matched between neighbours, then place the photos to a fraction of that.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy import sparse
from scipy.spatial.transform import Rotation

from ..arrays import Float64, Int64, UInt8
from ..capture import (
    USUAL_FOCAL,
    CalibrateConfig,
    Camera,
    Capture,
    held_out_views,
    place_by_head,
    portrait_frame_from_landmarks,
    read_source,
    some_depth,
)
from ..progress import Progress, note
from .detect import detect_landmarks
from .landmarks import EGG, GENERIC_LANDMARKS
from .segmentation import person_matte

_OWN = 0.06  # How far a person's landmarks lie from the generic head's, portrait units.
_JAW = 0.25  # Weight of the jaw's landmarks: on a turned face they slide along the outline.
_HIDDEN = 0.3
"""Cosine between a landmark's normal and the way to the camera below which it is guessed."""
_BETTER = 0.6
"""Part of the photos with a face that features of the head must place, to be believed."""
_NOISE = 0.015  # A detector's error, over the face's extent in the photo.
_LOOSE, _NOTED = 0.25, 0.03
"""Logarithm by which focal lengths differ from the usual one, and from noted ones."""
_FEW = 24  # Photos, at most, of which each is looked at thoroughly.
_FAR = 4.0
"""A photo whose landmarks are off by more than this many times the noise is of another face."""


@dataclass(frozen=True)
class FaceCameras:
    """Cameras and landmarks from the faces."""

    photos: list[int]  # Numbers of the photos that have a camera.
    cameras: Camera  # Theirs, about in the portrait frame.
    landmarks: Float64  # float64 [68, 3], of the person.
    error: float  # Root mean square error of the landmarks, over the face's extent.


def cameras_from_faces(landmarks: Sequence[Float64 | None], sizes: Sequence[tuple[int, int]],
                       focals: Sequence[float | None], lenses: Sequence[int]) -> FaceCameras | None:
    """The cameras of photos of one face; None if fewer than three photos fit together.

    Of each photo: landmarks float64 [68, 2] in pixels, or None where no face was found; width and
    height in pixels; the focal length in pixels that the camera noted, or None; the number of its
    lens, as those of one lens share a focal length.
    """
    photos = [k for k, points in enumerate(landmarks) if points is not None]
    for _ in range(3):
        if len(photos) < 3:
            return None
        found, errors = _fitted([np.asarray(landmarks[k]) for k in photos],
                                [sizes[k] for k in photos], [focals[k] for k in photos],
                                [lenses[k] for k in photos], photos)
        far = errors > max(_FAR * _NOISE, 3.0 * float(np.median(errors)))
        if not far.any():
            return found
        photos = [k for k, out in zip(photos, far) if not out]
    return None


def capture_from_faces(photos: Path, config: CalibrateConfig, progress: Progress | None = None,
                       ) -> Capture | None:
    """A capture of a folder of photos, or of a video, whose cameras come from the face alone.

    It is about in the portrait frame and has no landmarks; ``figures`` are as `calibrate`'s. None
    if fewer than three photos, or than three fifths of those with a face, show one and the same
    head.
    """
    loaded = read_source(photos, config.max_side, config.video_frames)
    landmarks = _faces([np.ascontiguousarray(photo.image[..., :3]) for photo in loaded], progress)
    kinds = [(photo.image.shape, photo.lens) for photo in loaded]
    sizes = [(photo.image.shape[1], photo.image.shape[0]) for photo in loaded]
    found = cameras_from_faces(landmarks, sizes, [photo.focal for photo in loaded],
                               [kinds.index(kind) for kind in kinds])
    if found is None:
        return None
    kept = [loaded[k] for k in found.photos]
    images = [np.ascontiguousarray(photo.image[..., :3]) for photo in kept]
    alphas = ([np.ascontiguousarray(photo.image[..., 3]) for photo in kept]
              if all(photo.image.shape[2] == 4 for photo in kept) else None)
    capture = Capture(found.cameras, images, alphas, [photo.name for photo in kept],
                      np.zeros(len(kept), bool), np.eye(4), found.landmarks,
                      depths=some_depth([photo.depth for photo in kept]))
    capture = capture.reframed(portrait_frame_from_landmarks(found.landmarks, found.cameras))
    note(progress, "placing the photos by the head alone")
    soft = [person_matte(image, _up(capture, view)) for view, image in enumerate(images)]
    placed = place_by_head(capture, soft, config.seed)
    # Landmarks of different people fit one head as well; features of the head do not.
    if placed is None or len(placed) < _BETTER * len(kept):
        return None
    figures = {"photos": len(loaded), "registered": len(placed), "blurred": [],
               "left_out": [photo.name for photo in loaded if photo.name not in placed.names],
               "placed": "by the face's landmarks, then features of the head",
               "focal_px": float(np.median(placed.cameras.focal[:, 0]))}
    return replace(placed, held_out=held_out_views(len(placed), config.holdout), landmarks=None,
                   figures=figures)


def _faces(images: list[UInt8], progress: Progress | None) -> list[Float64 | None]:
    """Landmarks of each photo; of many, of those in which a first look finds a face."""
    def look(number: int, thorough: bool) -> Float64 | None:
        note(progress, f"looking for the face in photo {number + 1} of {len(images)}")
        return detect_landmarks(images[number], turns=(0, 1, 3), thorough=thorough)

    # A thorough look takes a second where there is no face: from behind, on a turntable.
    return [look(number, True) if len(images) <= _FEW or look(number, False) is not None else None
            for number in range(len(images))]


def _up(capture: Capture, view: int) -> Float64:
    """The world's up direction in a photo, [2] (x right, y down)."""
    return np.asarray(capture.cameras.pose[view, :3, :3].T @ [0.0, 1.0, 0.0])[:2]


def _fitted(observed: list[Float64], sizes: list[tuple[int, int]], focals: list[float | None],
            lenses: list[int], photos: list[int]) -> tuple[FaceCameras, Float64]:
    """Cameras of all photos, and the error of each."""
    from scipy.optimize import least_squares

    seen = np.stack(observed)
    extent = np.linalg.norm(np.ptp(seen[:, 17:], axis=1), axis=1)
    center = np.array(sizes, np.float64) / 2
    kinds = {lens: place for place, lens in enumerate(dict.fromkeys(lenses))}
    kind = np.array([kinds[lens] for lens in lenses])
    first = np.array([focal or USUAL_FOCAL * max(size) for focal, size in zip(focals, sizes)])
    start_focal = np.array([np.median(first[kind == k]) for k in range(len(kinds))])
    noted = np.array([any(focals[i] for i in np.flatnonzero(kind == k)) for k in range(len(kinds))])
    poses = np.stack([_first_pose(points, focal, middle) for points, focal, middle
                      in zip(seen, start_focal[kind], center)])
    weight = np.sqrt(_shown(poses))[..., None]
    count, own = len(seen), 3 * 68

    def parts(values: Float64) -> tuple[Float64, Float64, Float64]:
        return (values[:own].reshape(68, 3), values[own:own + 6 * count].reshape(count, 6),
                start_focal * np.exp(values[own + 6 * count:]))

    def away(values: Float64) -> Float64:
        head, pose, focal = parts(values)
        local = np.einsum("vij,nj->vni", Rotation.from_rotvec(pose[:, :3]).as_matrix(), head)
        local = local + pose[:, None, 3:]
        depth = np.maximum(local[..., 2:], 0.1)
        shown = local[..., :2] / depth * focal[kind, None, None] + center[:, None]
        return np.asarray((shown - seen) / extent[:, None, None])

    def left_over(values: Float64) -> Float64:
        head, _, focal = parts(values)
        prior = (head - GENERIC_LANDMARKS) / _OWN
        lens = np.log(focal / start_focal) / np.where(noted, _NOTED, _LOOSE)
        # Robust by itself: the priors are to stay least squares.
        errors = away(values) * weight / _NOISE
        length = np.linalg.norm(errors, axis=-1, keepdims=True)
        errors *= np.sqrt(2 * (np.sqrt(1 + length ** 2 / 9) - 1) * 9) / np.maximum(length, 1e-9)
        return np.concatenate([errors.ravel(), prior.ravel(), lens])

    start = np.concatenate([GENERIC_LANDMARKS.ravel(), poses.ravel(), np.zeros(len(kinds))])
    found = least_squares(left_over, start, jac_sparsity=_pattern(count, kind, len(kinds)),
                          x_scale="jac", max_nfev=60)
    head, pose, focal = parts(found.x)
    errors = np.linalg.norm(away(found.x)[:, 17:], axis=-1)
    rms = np.sqrt((errors ** 2).mean(axis=1))
    return FaceCameras(photos, _cameras(pose, focal[kind], sizes), head,
                       float(np.sqrt((rms ** 2).mean()))), rms


def _cameras(poses: Float64, focal: Float64, sizes: list[tuple[int, int]]) -> Camera:
    """Cameras of rotation vectors and shifts, world to camera, [V, 6], and focal lengths [V]."""
    world = np.tile(np.eye(4), (len(poses), 1, 1))
    turn = Rotation.from_rotvec(poses[:, :3]).as_matrix().transpose(0, 2, 1)
    world[:, :3, :3] = turn
    world[:, :3, 3] = -np.einsum("vij,vj->vi", turn, poses[:, 3:])
    width, height = np.array(sizes).T
    return Camera(world, np.repeat(focal[:, None], 2, axis=1), np.array(sizes, np.float64) / 2,
                  width, height)


def _shown(poses: Float64) -> Float64:
    """How far to believe each landmark, [V, 68]: a detector guesses those on the far side."""
    turn = Rotation.from_rotvec(poses[:, :3]).as_matrix()
    eye = -np.einsum("vji,vj->vi", turn, poses[:, 3:])
    normal = GENERIC_LANDMARKS / EGG ** 2
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    away = eye[:, None] - GENERIC_LANDMARKS
    cosine = (away * normal).sum(axis=-1) / np.linalg.norm(away, axis=-1)
    weight = np.clip((cosine - _HIDDEN) / (1 - _HIDDEN), 0.0, 1.0)
    return np.where(np.arange(68) < 17, _JAW, 1.0) * np.maximum(weight, 0.01)


def _first_pose(points: Float64, focal: float, center: Float64) -> Float64:
    """Rotation vector and shift, world to camera, of a photo by the generic head, [6]."""
    matrix = np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1.0]])
    inner = slice(17, 68)
    _, turns, shifts, _ = cv2.solvePnPGeneric(GENERIC_LANDMARKS[inner], points[inner], matrix, None,
                                              flags=cv2.SOLVEPNP_SQPNP)
    turn, shift = cv2.solvePnPRefineLM(GENERIC_LANDMARKS[inner], points[inner], matrix, None,
                                       turns[0], shifts[0])
    return np.concatenate([np.ravel(turn), np.ravel(shift)])


def _pattern(count: int, kind: Int64, kinds: int) -> sparse.csr_array:
    """Which values each of the residuals depends on."""
    rows = 2 * 68 * count
    pattern = sparse.lil_array((rows + 3 * 68 + kinds, 3 * 68 + 6 * count + kinds), dtype=np.int8)
    landmark = np.repeat(np.tile(np.arange(68), count), 2)
    view = np.repeat(np.arange(count), 2 * 68)
    line = np.arange(rows)
    for k in range(3):
        pattern[line, 3 * landmark + k] = 1
    for k in range(6):
        pattern[line, 3 * 68 + 6 * view + k] = 1
    pattern[line, 3 * 68 + 6 * count + kind[view]] = 1
    prior = np.arange(3 * 68)
    pattern[rows + prior, prior] = 1
    pattern[rows + 3 * 68 + np.arange(kinds), 3 * 68 + 6 * count + np.arange(kinds)] = 1
    return pattern.tocsr()
