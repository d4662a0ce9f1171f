"""Outputs to view and share: page, videos, moving light fields, 3D files, report."""

from .export import ExportConfig, export_field
from .frames import (
    QUILTS,
    SECONDS,
    DrivePlan,
    FrameConfig,
    QuiltName,
    export_frame,
    fill_drive,
    kind_of,
    write_quilt,
)
from .page import OpenPage, PageConfig, page_script, recolored, serve_page, write_page
from .paths import (
    orbit_cameras,
    path_cameras,
    sweep_cameras,
    sweep_degrees,
    sweep_frames,
    sweep_ground,
)
from .report import Picture, Report, Section, Table, write_report
from .sequence import SequenceConfig, each_frame, write_sequence
from .video import write_video

__all__ = ["QUILTS", "SECONDS", "DrivePlan", "ExportConfig", "FrameConfig", "OpenPage",
           "PageConfig", "Picture", "QuiltName", "Report", "Section", "SequenceConfig", "Table",
           "each_frame", "export_field", "export_frame", "fill_drive", "kind_of", "orbit_cameras",
           "page_script", "path_cameras", "recolored", "serve_page", "sweep_cameras",
           "sweep_degrees", "sweep_frames", "sweep_ground", "write_page", "write_quilt",
           "write_report", "write_sequence", "write_video"]
