"""From a field to a light-field display: one ray for each sub-pixel (Shen et al. 2023, 2.3, Eq. 8).

`display` knows the panel, `mask` the view of each sub-pixel, `encode` codes a field for it;
`interlacing` codes pictures of views, `deinterlacing` takes coded pictures apart; `simulate` shows
what an eye sees, `patterns` whether the panel's numbers are right, `budget` how deep is sharp.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
