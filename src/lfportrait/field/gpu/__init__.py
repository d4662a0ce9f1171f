"""A field on a GPU: its bricks as a texture, shared by everything that casts rays through it."""

from ..kernels.texture import PROBES, REACH
from .atlas import (
    Atlas,
    DeviceTexture,
    FieldParts,
    TextureParts,
    field_parts,
    keep_texture,
    picture_texture,
    shader,
    texture_parts,
    upload,
)
from .view import ViewJob, keep_field, render_views, views_on_gpu

__all__ = ["PROBES", "REACH", "Atlas", "DeviceTexture", "FieldParts", "TextureParts", "ViewJob",
           "field_parts", "keep_field", "keep_texture", "picture_texture", "render_views",
           "shader", "texture_parts", "upload", "views_on_gpu"]
