from .coding import (
    ViewMask,
    code_on_device,
    composed,
    depth_budget,
    encode,
    encode_rows,
    encode_with_figures,
    render_view,
    view_camera,
)
from .display import Display, customary_views, lossless, read_coded, write_coded
from .ground import Ground, backdrop_of, ground_of, world_ground
from .interlacing import (
    assemble_quilt,
    deinterlace,
    each_view,
    interlace,
    quilt_tiles,
    read_views,
    simulate,
)
from .patterns import pattern
from .placement import DepthReport, EncodeConfig, InterlaceConfig, Placement
from .quilts import QuiltHint, QuiltLayout, layout_for, layout_of_file, quilt_part
from .views import Renderer, eight_bit, encode_views, quilt_of, render_views

__all__ = ["DepthReport", "Display", "EncodeConfig", "Ground", "InterlaceConfig", "Placement",
           "QuiltHint", "QuiltLayout", "Renderer", "ViewMask", "assemble_quilt", "backdrop_of",
           "code_on_device", "composed", "customary_views", "deinterlace", "depth_budget",
           "each_view", "eight_bit", "encode", "encode_rows", "encode_views",
           "encode_with_figures", "ground_of", "interlace", "layout_for", "layout_of_file",
           "lossless", "pattern", "quilt_of", "quilt_part", "quilt_tiles", "read_coded",
           "read_views", "render_view", "render_views", "simulate", "view_camera", "world_ground",
           "write_coded"]
