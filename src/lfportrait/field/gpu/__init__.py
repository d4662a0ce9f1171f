"""A field on a GPU: its bricks as a texture, shared by everything that casts rays through it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
