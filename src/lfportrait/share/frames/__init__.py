"""Pictures and videos for frames, stereo viewers and flat panels, and the drives they stand on.

`export` writes what a file's name asks for: a quilt, a package of Looking Glass Studio, a stereo
pair, color and depth, an anaglyph, a flat video. `fill_drive` fills the drive of a frame that
stands alone.
"""

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .config import FrameConfig
    from .drive import DrivePlan, fill_drive
    from .metadata import SECONDS
    from .names import QuiltName
    from .quilts import QUILTS, QuiltPlan, write_quilt

__all__ = ["QUILTS", "SECONDS", "DrivePlan", "FrameConfig", "QuiltName", "QuiltPlan", "fill_drive",
           "write_quilt"]

__getattr__, __dir__ = attach(__name__, __file__)
