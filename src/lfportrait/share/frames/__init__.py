"""Pictures and videos for frames, stereo viewers and flat panels, and the drives they stand on.

`export` writes what a file's name asks for: a quilt, a package of Looking Glass Studio, a stereo
pair, color and depth, an anaglyph, a flat video. `fill_drive` fills the drive of a frame that
stands alone.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
