from .config import FrameConfig
from .drive import DrivePlan, fill_drive
from .metadata import SECONDS
from .names import QuiltName
from .quilts import QUILTS, QuiltPlan, write_quilt

__all__ = ["QUILTS", "SECONDS", "DrivePlan", "FrameConfig", "QuiltName", "QuiltPlan", "fill_drive",
           "write_quilt"]
