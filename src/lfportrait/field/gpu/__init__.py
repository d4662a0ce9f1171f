"""A field on a GPU: its bricks as a texture, shared by everything that casts rays through it."""

from .atlas import Atlas, FieldParts, field_parts, upload
from .shaders import shader

__all__ = ["Atlas", "FieldParts", "field_parts", "shader", "upload"]
