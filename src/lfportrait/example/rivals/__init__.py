"""Methods of others to repaint a portrait by example, to compare with (Shen et al. 2023, Fig. 6).

FaceBlit (Texler et al. 2021), FaceStyle (Fiser et al. 2017), and a network that learnt one style
(Futschik et al. 2019). All hand back a `Painted`.
"""

from .faceblit import STEPS, FaceBlit, FaceBlitConfig, published_table
from .facestyle import FaceStyle, FaceStyleConfig
from .network import NetworkConfig, StyleNetwork
from .painted import Painted

__all__ = ["STEPS", "FaceBlit", "FaceBlitConfig", "FaceStyle", "FaceStyleConfig", "NetworkConfig",
           "Painted", "StyleNetwork", "published_table"]
