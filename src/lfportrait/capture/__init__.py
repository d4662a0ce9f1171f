"""Photos, video or a calibrated data set -> `Capture`: pictures, cameras, mattes, landmarks."""

from .calibrate import CalibrateConfig, calibrate
from .camera import Camera
from .capture import Capture
from .distortion import Lens, undistort
from .formats import is_calibrated
from .frame import looks_normalised, portrait_frame_from_cameras, portrait_frame_from_landmarks
from .mattes import consistent_mattes, matte_agreement, refine_matte
from .photos import is_video, load_photos
from .video import video_frames

__all__ = [
    "CalibrateConfig", "Camera", "Capture", "Lens", "calibrate", "consistent_mattes",
    "is_calibrated", "is_video", "load_photos", "looks_normalised", "matte_agreement",
    "portrait_frame_from_cameras", "portrait_frame_from_landmarks", "refine_matte", "undistort",
    "video_frames",
]
