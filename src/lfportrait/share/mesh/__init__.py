"""Textured meshes of a field: the surface with its painting as a picture, for GLB, USDZ and OBJ."""

from .baking import TexturedMesh, bake_texture
from .glb import write_colored_glb, write_textured_glb
from .names import plain_stem
from .obj import write_colored_obj, write_textured_obj
from .ply import write_ply
from .usdz import write_usdz

__all__ = ["TexturedMesh", "bake_texture", "plain_stem", "write_colored_glb", "write_colored_obj",
           "write_ply", "write_textured_glb", "write_textured_obj", "write_usdz"]
