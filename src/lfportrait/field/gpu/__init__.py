"""A field on a GPU: its bricks as a texture, shared by everything that casts rays through it."""

from ..kernels.texture import PROBES, REACH
from .atlas import Atlas, FieldParts, field_parts, upload
from .calling import keep_field, views_on_gpu
from .shaders import shader
from .textures import DeviceTexture, TextureParts, keep_texture, picture_texture, texture_parts
from .view import ViewJob, render_views

__all__ = [
           "PROBES",
           "REACH",
           "Atlas",
           "DeviceTexture",
           "FieldParts",
           "TextureParts",
           "ViewJob",
           "field_parts",
           "keep_field",
           "keep_texture",
           "picture_texture",
           "render_views",
           "shader",
           "texture_parts",
           "upload",
           "views_on_gpu",
]
