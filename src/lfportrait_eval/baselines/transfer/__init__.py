"""Published methods of transfer by example, for comparison (Shen et al. 2023, Fig. 6).

FaceBlit (Texler et al. 2021), FaceStyle (Fiser et al. 2017), and a network that learnt one style
(Futschik et al. 2019). All hand back a `Painted`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
