from .capture import Camera, Capture, calibrate
from .errors import UserError
from .example import Exemplar, Skin, transfer
from .field import VoxelField, reconstruct
from .job import Session, make
from .lightfield import Display, ViewMask, encode, simulate
from .stylize import StyledField, paint, stylize
from .version import __version__

__all__ = [
    "Camera", "Capture", "Display", "Exemplar", "Session", "Skin", "StyledField", "UserError",
    "ViewMask", "VoxelField", "__version__", "calibrate", "encode", "make", "paint", "reconstruct",
    "simulate", "stylize", "transfer",
]
