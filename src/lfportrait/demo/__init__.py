"""Data that comes with the package: a modelled head, photographed and painted by programs."""

from .head_model import HeadModel
from .painting import demo_exemplar, demo_styles, exemplar_camera, style_makers
from .people import PAINTED, SITTER, landmarks
from .sittings import embedded_sittings
from .studio import Picture, demo_cameras, demo_capture, photograph

__all__ = ["PAINTED", "SITTER", "HeadModel", "Picture", "demo_cameras", "demo_capture",
           "demo_exemplar", "demo_styles", "embedded_sittings", "exemplar_camera", "landmarks",
           "photograph", "style_makers"]
