"""Pictures and videos for frames, stereo viewers and flat panels, and the drives they stand on.

A file's name says what it holds: a quilt, a package of Looking Glass Studio, a stereo pair, color
and depth, an anaglyph, a flat video (`export_frame`). `fill_drive` fills the drive of a frame that
stands alone.
"""

from .config import FrameConfig
from .drive import DrivePlan, fill_drive
from .export import export_frame
from .metadata import SECONDS
from .names import QuiltName, kind_of
from .quilts import QUILTS, QuiltPlan, write_quilt

__all__ = ["QUILTS", "SECONDS", "DrivePlan", "FrameConfig", "QuiltName", "QuiltPlan",
           "export_frame", "fill_drive", "kind_of", "write_quilt"]
