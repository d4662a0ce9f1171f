"""Transfer to videos: strokes move with the content.

`frames` does it, by `motion` (optical flow); `carried_frames` and `pipelining` make it fast.
"""

from . import VideoTransfer

__all__ = ["VideoTransfer"]
