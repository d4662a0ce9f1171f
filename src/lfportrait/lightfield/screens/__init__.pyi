from .bridge import URL, Bridge, DepthPicture, Device, Entry
from .live import (
    LiveWindow,
    OffscreenWindow,
    check_packages,
    fields_to_show,
    live_adapter,
    screen_sizes,
    show_field,
    show_live,
)
from .show import PygameDriver, show

__all__ = ["URL", "Bridge", "DepthPicture", "Device", "Entry", "LiveWindow", "OffscreenWindow",
           "PygameDriver", "check_packages", "fields_to_show", "live_adapter", "screen_sizes",
           "show", "show_field", "show_live"]
