"""Transfer to videos: strokes that are carried along with the motion."""

from .frames import VideoTransfer

__all__ = ["VideoTransfer"]
