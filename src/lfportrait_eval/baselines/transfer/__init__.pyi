from .faceblit import STEPS, FaceBlit, published_table
from .facestyle import FaceStyle
from .network import StyleNetwork

__all__ = ["STEPS", "FaceBlit", "FaceStyle", "StyleNetwork", "published_table"]
