"""Transfer by example: any portrait repainted in the manner of one painting (Paper 2.2, Eq. 6).

An `Exemplar` is the painting, a `Transfer` repaints photos by it: `guides` say which place of the
painting answers a pixel, `styleblit` looks it up and copies pieces. `surface_guide` does it on
a head, the same from every side; `video` is for moving pictures; `methods` finds those of other
packages.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
