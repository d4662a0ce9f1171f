"""The embedded data: a synthetic head, with rendered photos and painted exemplars."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
