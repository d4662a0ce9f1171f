from .capture_head import fit_to_surface
from .detect import (
    detect_faces,
    detect_landmarks,
    detectors_key,
    face_mesh,
    face_yaw,
    frontal_order,
    landmarks_of_capture,
    triangulate,
)
from .face_cameras import capture_from_faces
from .glasses import IN_PHOTOS, dark_glasses, drawn_spectacles, find_spectacles, spectacle_lenses
from .landmarks import (
    FROM_MEDIAPIPE,
    GENERIC_LANDMARKS,
    MOST_TURNED,
    PORTRAIT_CONE,
    FacePose,
    face_pose,
    generic_depth,
    is_portrait,
    mouth_opening,
    read_landmarks,
    symmetric_landmarks,
    write_landmarks,
)
from .one_photo.beside import faces_of_people
from .one_photo.portrait import portrait_capture, portrait_field
from .segmentation import face_mask, hair_mask, mattes, parts, person_matte

__all__ = ["FROM_MEDIAPIPE", "GENERIC_LANDMARKS", "IN_PHOTOS", "MOST_TURNED", "PORTRAIT_CONE",
           "FacePose", "capture_from_faces", "dark_glasses", "detect_faces", "detect_landmarks",
           "detectors_key", "drawn_spectacles", "face_mask", "face_mesh", "face_pose", "face_yaw",
           "faces_of_people", "find_spectacles", "fit_to_surface", "frontal_order",
           "generic_depth", "hair_mask", "is_portrait", "landmarks_of_capture", "mattes",
           "mouth_opening", "parts", "person_matte", "portrait_capture", "portrait_field",
           "read_landmarks", "spectacle_lenses", "symmetric_landmarks", "triangulate",
           "write_landmarks"]
