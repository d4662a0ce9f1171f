"""lfportrait: photos and one painting in, a stylised 3D portrait for a light-field display out.

The whole job in five lines::

    import lfportrait as lf

    capture = lf.Capture.load("photos/")            # or lf.calibrate("photos/")
    field = lf.reconstruct(capture)
    styled = lf.stylize(field, capture, lf.Exemplar.load("ken.png"))
    image = lf.encode(styled, lf.Display.preset("lookingglass-16"))  # uint8 [H, W, 3]
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

__all__ = [
    "Camera", "Capture", "Display", "Exemplar", "UserError", "ViewMask", "VoxelField",
    "calibrate", "encode", "make", "reconstruct", "simulate", "stylize", "transfer",
]

_HOMES = {
    "Camera": "capture", "Capture": "capture", "calibrate": "capture",
    "VoxelField": "field", "reconstruct": "field",
    "Exemplar": "example", "transfer": "example",
    "stylize": "stylize",
    "Display": "lightfield", "ViewMask": "lightfield", "encode": "lightfield",
    "simulate": "lightfield",
    "make": "job", "UserError": "errors",
}

def __getattr__(name: str) -> Any:
    # Stages are imported when they are asked for: torch and Numba take seconds.
    if name in _HOMES:
        return getattr(import_module(f".{_HOMES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
