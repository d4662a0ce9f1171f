from .head_model import HeadModel
from .lattice import head_field
from .painting import demo_exemplar, exemplar_camera
from .people import PAINTED, PEOPLE, SITTER, landmarks
from .sittings import embedded_sittings
from .studio import Picture, demo_cameras, demo_capture, photograph
from .styles import demo_styles, style_makers

__all__ = ["PAINTED", "PEOPLE", "SITTER", "HeadModel", "Picture", "demo_cameras", "demo_capture",
           "demo_exemplar", "demo_styles", "embedded_sittings", "exemplar_camera", "head_field",
           "landmarks", "photograph", "style_makers"]
