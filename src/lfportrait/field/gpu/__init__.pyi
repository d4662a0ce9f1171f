from .atlas import (
    Atlas,
    DeviceTexture,
    ViewJob,
    field_parts,
    keep_field,
    keep_texture,
    picture_texture,
    render_views,
    shader,
    texture_parts,
    upload,
    views_on_gpu,
)

__all__ = ["Atlas", "DeviceTexture", "ViewJob",
           "field_parts", "keep_field", "keep_texture", "picture_texture", "render_views",
           "shader", "texture_parts", "upload", "views_on_gpu"]
