"""Photos, video or a calibrated data set -> `Capture`: pictures, cameras, mattes, landmarks."""

from .camera import Camera
from .capture import Capture
from .distortion import Lens, undistort
from .formats import is_calibrated
from .frame import looks_normalised, portrait_frame_from_cameras, portrait_frame_from_landmarks

__all__ = [
    "Camera", "Capture", "Lens", "is_calibrated", "looks_normalised",
    "portrait_frame_from_cameras", "portrait_frame_from_landmarks", "undistort",
]
