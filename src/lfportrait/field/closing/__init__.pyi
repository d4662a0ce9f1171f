from .fitted_head import FitHead, FittedHead
from .sides import Closed, close_back, close_sides

__all__ = ["Closed", "FitHead", "FittedHead", "close_back", "close_sides"]
