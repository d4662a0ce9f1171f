from .embedded import (
    DATA,
    HEAD,
    demo_capture,
    demo_exemplar,
    demo_head,
    demo_landmarks,
    demo_photo,
    embedded_sittings,
)
from .styles import demo_styles, style_makers

__all__ = ["DATA", "HEAD", "demo_capture", "demo_exemplar", "demo_head", "demo_landmarks",
           "demo_photo", "demo_styles", "embedded_sittings", "style_makers"]
