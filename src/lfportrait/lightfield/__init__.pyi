from .budget import DepthReport
from .coded import lossless, read_coded, write_coded
from .coding import (
    code_on_device,
    depth_budget,
    encode,
    encode_rows,
    encode_with_figures,
    render_view,
    view_camera,
)
from .composition import composed
from .deinterlacing import deinterlace, each_view
from .display import Display
from .ground import Ground, backdrop_of, ground_of, world_ground
from .interlacing import (
    InterlaceConfig,
    assemble_quilt,
    interlace,
    quilt_tiles,
    read_views,
)
from .lookingglass import customary_views
from .mask import ViewMask
from .patterns import pattern
from .placement import EncodeConfig, Placement
from .quilt import quilt_of
from .quilts import QuiltHint, QuiltLayout, layout_for, layout_of_file, quilt_part
from .renderers import Renderer, encode_views
from .simulation import simulate
from .views import eight_bit, render_views

__all__ = ["DepthReport", "Display", "EncodeConfig", "Ground", "InterlaceConfig", "Placement",
           "QuiltHint", "QuiltLayout", "Renderer", "ViewMask", "assemble_quilt", "backdrop_of",
           "code_on_device", "composed", "customary_views", "deinterlace", "depth_budget",
           "each_view", "eight_bit", "encode", "encode_rows", "encode_views",
           "encode_with_figures", "ground_of", "interlace", "layout_for", "layout_of_file",
           "lossless", "pattern", "quilt_of", "quilt_part", "quilt_tiles", "read_coded",
           "read_views", "render_view", "render_views", "simulate", "view_camera", "world_ground",
           "write_coded"]
