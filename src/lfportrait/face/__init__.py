"""Faces: 68 landmarks in pictures and in space, masks of face, hair and person (Paper Fig. 3).

Detectors and segmentation run pretrained networks of the registry. All is imported when it is asked
for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
