from .frames.files import QUILTS, SECONDS, FrameConfig, QuiltName
from .frames.quilts import DrivePlan, fill_drive, write_quilt
from .kinds import (
    Export,
    ExportConfig,
    ExportContext,
    NoParameters,
    Option,
    PageConfig,
    SplatConfig,
    export_field,
    export_of,
    exports,
    own_exports,
)
from .page.assembly import OpenPage, page_script, recolored, serve_page, write_page
from .report import Picture, Report, Section, Table, write_report
from .video import (
    SequenceConfig,
    each_frame,
    good_cone,
    orbit_cameras,
    path_cameras,
    sweep_cameras,
    sweep_degrees,
    sweep_frames,
    sweep_ground,
    write_sequence,
    write_video,
)

__all__ = ["QUILTS", "SECONDS", "DrivePlan", "Export", "ExportConfig", "ExportContext",
           "FrameConfig", "NoParameters", "OpenPage", "Option", "PageConfig", "Picture",
           "QuiltName", "Report", "Section", "SequenceConfig", "SplatConfig", "Table", "each_frame",
           "export_field", "export_of", "exports", "fill_drive", "good_cone", "orbit_cameras",
           "own_exports", "page_script", "path_cameras", "recolored", "serve_page", "sweep_cameras",
           "sweep_degrees", "sweep_frames", "sweep_ground", "write_page", "write_quilt",
           "write_report",
           "write_sequence", "write_video"]
