from .calibration.database import USUAL_FOCAL
from .calibration.head_motion import HeadMotion, follow_head, place_by_head
from .camera import (
    Camera,
    focus_point,
    laid_over,
    looks_normalised,
    portrait_frame_from_cameras,
    portrait_frame_from_landmarks,
    pose_corrections,
    without_drift,
)
from .capture import Capture, LatePictures
from .facts import (
    DataSetFacts,
    DepthFacts,
    PictureFacts,
    VideoFacts,
    data_set_facts,
    picture_facts,
    video_facts,
)
from .formats import (
    CaptureFormat,
    DataSet,
    Shot,
    Views,
    capture_formats,
    held_out_views,
    is_calibrated,
)
from .lenses import Lens, some_depth, undistort
from .mattes import (
    color_likelihood,
    consistent_mattes,
    holes_of,
    lattice_votes,
    matte_agreement,
    mattes_share,
    refine_changes,
    refine_matte,
    views_share,
)
from .photo_cameras import CalibrateConfig, PhotosError, calibrate
from .photos import (
    Photo,
    fineness,
    is_video,
    photo_listing,
    picture_files,
    read_photos,
    relative_sharpness,
)
from .video import read_source, read_video, video_frames

__all__ = [
    "USUAL_FOCAL", "CalibrateConfig", "Camera", "Capture", "CaptureFormat", "DataSet",
    "DataSetFacts", "DepthFacts", "HeadMotion", "LatePictures", "Lens", "Photo", "PhotosError",
    "PictureFacts", "Shot", "VideoFacts", "Views", "calibrate", "capture_formats",
    "color_likelihood", "consistent_mattes", "data_set_facts", "fineness", "focus_point",
    "follow_head", "held_out_views", "holes_of", "is_calibrated", "is_video", "laid_over",
    "lattice_votes", "looks_normalised", "matte_agreement", "mattes_share", "photo_listing",
    "picture_facts", "picture_files", "place_by_head", "portrait_frame_from_cameras",
    "portrait_frame_from_landmarks", "pose_corrections", "read_photos", "read_source", "read_video",
    "refine_changes", "refine_matte", "relative_sharpness", "some_depth", "undistort",
    "video_facts", "video_frames", "views_share", "without_drift",
]
