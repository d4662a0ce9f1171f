from ..config import FaceBlitConfig, FaceStyleConfig, NetworkConfig, Painted
from .faceblit import STEPS, FaceBlit, published_table
from .facestyle import FaceStyle
from .network import StyleNetwork

__all__ = ["STEPS", "FaceBlit", "FaceBlitConfig", "FaceStyle", "FaceStyleConfig", "NetworkConfig",
           "Painted", "StyleNetwork", "published_table"]
