"""The embedded data: a synthetic head, with rendered photos and painted exemplars."""

from typing import TYPE_CHECKING

from ..lazy import attach

if TYPE_CHECKING:
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

__getattr__, __dir__ = attach(__name__, __file__)
