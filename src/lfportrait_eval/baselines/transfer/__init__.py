"""Published methods of transfer by example, for comparison (Shen et al. 2023, Fig. 6).

FaceBlit (Texler et al. 2021), FaceStyle (Fiser et al. 2017), and a network that learnt one style
(Futschik et al. 2019). All hand back a `Painted`.
"""

from typing import TYPE_CHECKING

from lfportrait.lazy import attach

if TYPE_CHECKING:
    from .config import FaceBlitConfig, FaceStyleConfig, NetworkConfig, Painted
    from .faceblit import STEPS, FaceBlit, published_table
    from .facestyle import FaceStyle
    from .network import StyleNetwork

__all__ = ["STEPS", "FaceBlit", "FaceBlitConfig", "FaceStyle", "FaceStyleConfig", "NetworkConfig",
           "Painted", "StyleNetwork", "published_table"]

__getattr__, __dir__ = attach(__name__, __file__)
