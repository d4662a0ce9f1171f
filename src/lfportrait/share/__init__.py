"""Results to look at and pass on: videos, camera paths, and the report."""

from .paths import orbit_cameras, path_cameras, sweep_cameras, sweep_degrees, sweep_frames
from .report import Picture, Report, Section, Table, write_report
from .video import write_video

__all__ = ["Picture", "Report", "Section", "Table", "orbit_cameras", "path_cameras",
           "sweep_cameras", "sweep_degrees", "sweep_frames", "write_report", "write_video"]
