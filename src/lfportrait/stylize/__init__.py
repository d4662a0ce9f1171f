"""Optimising a field to a style: features, losses, color fit (Shen et al. 2023, 2.1-2.2).

A `StyledField` keeps the colors of the photo and of the paintings: `mixing` turns them up and down
without training.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
