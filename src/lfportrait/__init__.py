"""lfportrait: photos and one painting in, a stylised 3D portrait for a light-field display out.

The whole job in five lines::

    import lfportrait as lf

    capture = lf.Capture.load("photos/")            # or lf.calibrate("photos/")
    field = lf.reconstruct(capture)
    styled = lf.stylize(field, capture, lf.Exemplar.load("ken.png"))
    image = lf.encode(styled, lf.Display.preset("lookingglass-16"))  # uint8 [H, W, 3]
"""

from typing import TYPE_CHECKING

from .lazy import attach
from .version import __version__

if TYPE_CHECKING:
    from .capture import Camera, Capture, calibrate
    from .errors import UserError
    from .example import Exemplar, Skin, transfer
    from .field import VoxelField, reconstruct
    from .job import Session, make
    from .lightfield import Display, ViewMask, encode, simulate
    from .stylize import StyledField, paint, stylize

__all__ = [
    "Camera", "Capture", "Display", "Exemplar", "Session", "Skin", "StyledField", "UserError",
    "ViewMask", "VoxelField", "__version__", "calibrate", "encode", "make", "paint", "reconstruct",
    "simulate", "stylize", "transfer",
]

__getattr__, __dir__ = attach(__name__, __file__, {"evaluate": "lfportrait_eval"})
