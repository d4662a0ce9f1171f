"""Faces: 68 landmarks in pictures and in space, masks of face, hair and person (Paper Fig. 3).

Detectors and segmentation run pretrained networks of the registry; they are imported when called.
"""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from .. import models
from ..arrays import Float32, Float64, UInt8
from ..cache import key_of
from .detect import detect_faces, detect_landmarks, face_mesh, face_yaw
from .landmarks import (
    FIT,
    GENERIC_LANDMARKS,
    MOST_TURNED,
    PORTRAIT_CONE,
    FacePose,
    face_pose,
    generic_depth,
    read_landmarks,
    symmetric_landmarks,
    write_landmarks,
)
from .segmentation import face_mask
from .triangulate import frontal_order, landmarks_of_capture, triangulate

__all__ = [
    "GENERIC_LANDMARKS",
    "MOST_TURNED",
    "PORTRAIT_CONE",
    "FacePose",
    "capture_from_faces",
    "detect_faces",
    "detect_landmarks",
    "detectors_key",
    "face_mask",
    "face_mesh",
    "face_pose",
    "face_yaw",
    "fit_to_surface",
    "frontal_order",
    "generic_depth",
    "hair_mask",
    "is_portrait",
    "landmarks_of_capture",
    "mattes",
    "parts",
    "person_matte",
    "portrait_capture",
    "portrait_field",
    "read_landmarks",
    "symmetric_landmarks",
    "triangulate",
    "write_landmarks",
]


def detectors_key() -> str:
    """Hash of what finds landmarks: the networks that are at hand, and the code of this package."""
    return key_of(__name__, models.in_use(
        ["face-landmarker", "face-landmarks-68", "face-detector"]))


def capture_from_faces(photos: Path, config: Any, progress: Any = None) -> Any:
    """A capture with cameras from a face (`lfportrait.face.face_cameras.capture_from_faces`)."""
    from .face_cameras import capture_from_faces as run

    return run(photos, config, progress)


def is_portrait(capture: Any) -> bool:
    """Whether a capture's head was fitted to its photos (`one_photo`)."""
    return FIT in capture.figures


def fit_to_surface(landmarks: Float64, points: Float64,
                   normals: Float64, trust: Float64) -> Any:
    """The statistical head, fitted to a capture (`lfportrait.face.capture_head.fit_to_surface`)."""
    from .capture_head import fit_to_surface as run

    return run(landmarks, points, normals, trust)


def portrait_capture(photos: Any, progress: Any = None) -> Any:
    """A head fitted to one photo or a few (`lfportrait.face.one_photo.portrait_capture`)."""
    from .one_photo import portrait_capture as run

    return run(photos, progress)


def portrait_field(capture: Any, config: Any = None, progress: Any = None, *,
                   look: Any = None) -> Any:
    """The field of a fitted head (`lfportrait.face.one_photo.portrait_field`)."""
    from .one_photo import portrait_field as run

    return run(capture, config, progress, look=look)


def person_matte(image: UInt8, up: NDArray[Any] | None = None) -> Float32:
    """How much of each pixel is the person (`lfportrait.face.segmentation.person_matte`)."""
    from .segmentation import person_matte as run

    return run(image, up)


def hair_mask(image: UInt8, up: NDArray[Any] | None = None, size: int = 512,
              ) -> Float32:
    """How much of each pixel is hair (`lfportrait.face.segmentation.hair_mask`)."""
    from .segmentation import hair_mask as run

    return run(image, up, size)


def mattes(image: UInt8, up: NDArray[Any] | None = None, size: int = 512,
           ) -> tuple[Float32, Float32]:
    """Person and hair at the same time (`lfportrait.face.segmentation.mattes`)."""
    from .segmentation import mattes as run

    return run(image, up, size)


def parts(image: UInt8, up: NDArray[Any] | None = None,
          ) -> dict[str, Float32]:
    """How much of each pixel is each of six parts (`lfportrait.face.segmentation.parts`)."""
    from .segmentation import parts as run

    return run(image, up)
