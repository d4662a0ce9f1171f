"""Videos repainted by example: strokes move with what they lie on, instead of swimming.

`frames` does it, by `motion` (optical flow); `carried_frames` and `pipelining` make it fast.
"""

from .frames import VideoTransfer

__all__ = ["VideoTransfer"]
