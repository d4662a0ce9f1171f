from .clean_plates import plate_mattes
from .head_surface import bust_chart, bust_distance, find_surface
from .mattes import cut_out, trim

__all__ = ["bust_chart", "bust_distance", "cut_out", "find_surface", "plate_mattes", "trim"]
