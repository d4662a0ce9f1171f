"""lfportrait: photos and one painting in, a stylised 3D portrait for a light-field display out.

The whole job in five lines::

    import lfportrait as lf

    capture = lf.Capture.load("photos/")            # or lf.calibrate("photos/")
    field = lf.reconstruct(capture)
    styled = lf.stylize(field, capture, lf.Exemplar.load("ken.png"))
    image = lf.encode(styled, lf.Display.preset("lookingglass-16"))  # uint8 [H, W, 3]
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
