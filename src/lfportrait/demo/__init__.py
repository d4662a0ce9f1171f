"""The embedded data: photos of a modelled head, paintings, and portraits of other people."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
