"""Pictures shown on real panels: full screen, or through a running Looking Glass Bridge."""

from .bridge import URL, Bridge, DepthPicture, Device, Entry
from .show import PygameDriver, show

__all__ = ["URL", "Bridge", "DepthPicture", "Device", "Entry", "PygameDriver", "show"]
