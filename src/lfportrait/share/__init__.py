"""Results to look at and to pass on: videos, moving light fields, 3D files, the report."""

from .export import ExportConfig, export_field
from .paths import orbit_cameras, path_cameras, sweep_cameras, sweep_degrees, sweep_frames
from .report import Picture, Report, Section, Table, write_report
from .sequence import SequenceConfig, each_frame, write_sequence
from .video import write_video

__all__ = ["ExportConfig", "Picture", "Report", "Section", "SequenceConfig", "Table", "each_frame",
           "export_field", "orbit_cameras", "path_cameras", "sweep_cameras", "sweep_degrees",
           "sweep_frames", "write_report", "write_sequence", "write_video"]
