"""Displays, mask guide, coding, quilts, simulation, patterns (Shen et al. 2023, 2.3, Eq. 8)."""

from .coded import read_coded, write_coded
from .display import Display
from .encode import (
    EncodeConfig,
    Placement,
    depth_budget,
    encode,
    encode_with_figures,
    render_view,
    view_camera,
)
from .mask import ViewMask
from .quilt import QuiltLayout, interlace, quilt_of, quilt_tiles
from .simulate import deinterlace, pattern, simulate

__all__ = ["Display", "EncodeConfig", "Placement", "QuiltLayout", "ViewMask", "deinterlace",
           "depth_budget", "encode", "encode_with_figures", "interlace", "pattern", "quilt_of",
           "quilt_tiles", "read_coded", "render_view", "simulate", "view_camera", "write_coded"]
