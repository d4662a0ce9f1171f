"""The first stage: photos, a video or a calibrated data set become a `Capture`.

A capture is pictures with their cameras, in the frame of the head, and what is known of the head:
its matte in each picture, its landmarks in space. `calibrate` finds the cameras of plain photos;
`formats` reads data sets that have them. What calibrates is imported when it is asked for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
