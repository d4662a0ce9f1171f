"""Files of splats: one writer for each format."""

from .gltf import write_glb
from .ply import write_ply
from .sog import write_sog
from .spz import write_spz

__all__ = ["WRITERS", "write_glb", "write_ply", "write_sog", "write_spz"]

WRITERS = {".ply": write_ply, ".glb": write_glb, ".spz": write_spz, ".sog": write_sog}
"""By the file's suffix: functions (stream, splats)."""
