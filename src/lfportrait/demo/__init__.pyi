from .captures import demo_capture, demo_landmarks
from .head import HEAD, demo_head
from .paintings import demo_exemplar
from .portraits import demo_photo, embedded_sittings
from .shipped import DATA
from .styles import demo_styles, style_makers

__all__ = ["DATA", "HEAD", "demo_capture", "demo_exemplar", "demo_head", "demo_landmarks",
           "demo_photo", "demo_styles", "embedded_sittings", "style_makers"]
