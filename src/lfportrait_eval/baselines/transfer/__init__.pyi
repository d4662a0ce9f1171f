from .config import FaceBlitConfig, FaceStyleConfig, NetworkConfig
from .faceblit import STEPS, FaceBlit, published_table
from .facestyle import FaceStyle
from .network import StyleNetwork
from .painted import Painted

__all__ = ["STEPS", "FaceBlit", "FaceBlitConfig", "FaceStyle", "FaceStyleConfig", "NetworkConfig",
           "Painted", "StyleNetwork", "published_table"]
