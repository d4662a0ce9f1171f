"""Finding a face and its 68 landmarks in one picture.

MediaPipe's face landmarker does most of the work, on the whole picture and, where it finds nothing,
on enlarged crops and turned by quarter turns. Paintings and sculptures that it does not take for a
face are tried with the face-api networks (`face68`).
"""

from __future__ import annotations

import atexit
import functools
import os
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import models
from .points import FROM_MEDIAPIPE, centred

__all__ = ["detect_landmarks", "face_yaw"]


@functools.lru_cache(maxsize=2)
def _landmarker(path: str) -> Any:
    """MediaPipe's detector for the model file, one a process, its chatter silenced."""
    os.environ.setdefault("GLOG_minloglevel", "3")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    saved = os.dup(2)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 2)
    try:
        from mediapipe.tasks.python import BaseOptions, vision

        options = vision.FaceLandmarkerOptions(
            base_options=BaseOptions(model_asset_path=path), num_faces=1,
            min_face_detection_confidence=0.4)
        detector = vision.FaceLandmarker.create_from_options(options)
        # When the process ends, closing would fail on threads and modules that are gone already
        # (and say so on standard error); the system frees everything anyway.
        atexit.register(setattr, detector, "_handle", None)
        detector.detect(_mediapipe_image(np.zeros((64, 64, 3), np.uint8)))
        return detector
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(silent)


def _mediapipe_image(image: NDArray[np.uint8]) -> Any:
    import mediapipe

    return mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB,
                           data=np.ascontiguousarray(image))


def _mesh(image: NDArray[np.uint8]) -> NDArray[np.float64] | None:
    """MediaPipe's points of the largest face mapped to 68 landmarks, [68, 2], or None."""
    found = _landmarker(str(models.fetch("face-landmarker"))).detect(_mediapipe_image(image))
    if not found.face_landmarks:
        return None
    height, width = image.shape[:2]
    mesh = np.array([(point.x * width, point.y * height) for point in found.face_landmarks[0]])
    return mesh[FROM_MEDIAPIPE]


def _windows(height: int, width: int) -> Iterator[tuple[int, int, int, int]]:
    """Crops (x0, y0, x1, y1) to try: the whole, then a middle, then overlapping quarters."""
    yield 0, 0, width, height
    for part in (0.7, 0.5):
        w, h = int(width * part), int(height * part)
        for fy in (0.5, 0.0, 1.0):
            for fx in (0.5, 0.0, 1.0):
                x, y = int((width - w) * fx), int((height - h) * fy)
                yield x, y, x + w, y + h


def _second_opinion(image: NDArray[np.uint8], points: NDArray[np.float64],
                    ) -> NDArray[np.float64]:
    """The mean of MediaPipe's landmarks and face-api's, where both saw the same face.

    The two err in different directions: over 14 painted and sculpted portraits the mean error is
    0.036 of the distance of the outer eye corners, against 0.040 and 0.045 of the single ones.
    """
    if not models.available("face-landmarks-68"):
        return points
    from .face68 import landmarks_in_box

    low, high = points.min(axis=0), points.max(axis=0)
    box = np.concatenate([low - 0.05 * (high - low), 1.1 * (high - low)])
    if (box[2:] < 16).any() or (low < 0).any() or (high > np.array(image.shape[1::-1])).any():
        return points
    other = landmarks_in_box(np.ascontiguousarray(image), box)
    eyes = float(np.linalg.norm(points[36] - points[45]))
    apart = np.linalg.norm(other - points, axis=1)
    return centred(0.5 * (points + other)) if apart.mean() < 0.15 * eyes else points


def detect_landmarks(image: NDArray[np.uint8], *, turns: tuple[int, ...] = (0,),
                     thorough: bool = True) -> NDArray[np.float64] | None:
    """The 68 landmarks of the largest face in a picture.

    Parameters
    ----------
    image
        uint8 [H, W, 3], sRGB.
    turns
        Quarter turns (counter-clockwise) of the picture to try, e.g. ``(0, 1, 2, 3)``.
    thorough
        Also try crops, and the face-api networks, where the whole picture shows no face; and
        refine the points by the mean of both networks.

    Returns
    -------
    landmarks
        float64 [68, 2] in pixels (x right, y down; iBUG order), or None if no face was found.
    """
    for turn in turns:
        turned = np.rot90(image, turn)
        height, width = turned.shape[:2]
        for x0, y0, x1, y1 in _windows(height, width) if thorough else [(0, 0, width, height)]:
            points = _mesh(turned[y0:y1, x0:x1])
            if points is not None:
                points = points + np.array([x0, y0])
                if thorough:
                    points = _second_opinion(turned, points)
                return _turn_back(points, turn, image.shape)
    if thorough and models.available("face-detector") and models.available("face-landmarks-68"):
        from .face68 import detect_landmarks68

        for turn in turns:
            points = detect_landmarks68(np.ascontiguousarray(np.rot90(image, turn)))
            if points is not None:
                return _turn_back(points, turn, image.shape)
    return None


def _turn_back(points: NDArray[np.float64], turn: int, shape: tuple[int, ...],
               ) -> NDArray[np.float64]:
    """Points found in a picture turned by quarter turns, in the picture itself."""
    height, width = shape[:2]
    x, y = points[:, 0], points[:, 1]
    match turn % 4:
        case 1:
            return np.stack([width - y, x], 1)
        case 2:
            return np.stack([width - x, height - y], 1)
        case 3:
            return np.stack([y, height - x], 1)
    return points


def face_yaw(landmarks: NDArray[np.float64]) -> float:
    """How far a face is turned, from -1 (profile to the left) over 0 (frontal) to 1.

    The nose tip's place between the outer corners of the eyes, along the line through them.
    """
    left, right = landmarks[36], landmarks[45]
    along = right - left
    share = (landmarks[30] - left) @ along / max(float(along @ along), 1e-9)
    return float(np.clip(2.0 * share - 1.0, -1.5, 1.5))
