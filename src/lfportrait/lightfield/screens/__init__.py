"""Pictures shown on real panels: full screen, or through a running Looking Glass Bridge."""

from .bridge import URL, Bridge, DepthPicture, Device
from .show import PygameDriver, show

__all__ = ["URL", "Bridge", "DepthPicture", "Device", "PygameDriver", "show"]
