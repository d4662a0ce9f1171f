"""Other methods of transfer, for comparison (Shen et al. 2023, Fig. 6).

FaceBlit, FaceStyle, and a network that learnt one style (Futschik et al. 2019).
"""

from .faceblit import STEPS, FaceBlit, FaceBlitConfig, published_table
from .facestyle import FaceStyle, FaceStyleConfig
from .network import NetworkConfig, StyleNetwork
from .painted import Painted

__all__ = ["STEPS", "FaceBlit", "FaceBlitConfig", "FaceStyle", "FaceStyleConfig", "NetworkConfig",
           "Painted", "StyleNetwork", "published_table"]
