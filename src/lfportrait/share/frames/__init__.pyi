from .files import SECONDS, FrameConfig, QuiltName
from .quilts import QUILTS, DrivePlan, QuiltPlan, fill_drive, write_quilt

__all__ = ["QUILTS", "SECONDS", "DrivePlan", "FrameConfig", "QuiltName", "QuiltPlan", "fill_drive",
           "write_quilt"]
