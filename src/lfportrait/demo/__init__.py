"""The embedded data: a modelled head photographed from known cameras, and painted exemplars."""

from ..kernels.head import HeadModel
from .painting import demo_exemplar, demo_styles, exemplar_camera
from .people import PAINTED, SITTER, landmarks
from .studio import Picture, demo_cameras, demo_capture, photograph

__all__ = ["PAINTED", "SITTER", "HeadModel", "Picture", "demo_cameras", "demo_capture",
           "demo_exemplar", "demo_styles", "exemplar_camera", "landmarks", "photograph"]
