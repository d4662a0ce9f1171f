"""Open a page in the user's browser without waiting for it.

`webbrowser.open` returns when the browser's process ends: at once where a window of it is open
already, after seconds where it must start, and after the page is closed where it runs in the
terminal (w3m, lynx) or in a script. Whoever serves the page must not wait for that.
"""

import contextlib
import threading
import webbrowser


def open_browser(address: str) -> threading.Thread:
    """Open an address in the user's browser, at once; the daemon thread that waits for it."""
    def opened() -> None:
        with contextlib.suppress(OSError, webbrowser.Error):  # the address is printed as well
            webbrowser.open(address)

    opening = threading.Thread(target=opened, name="browser", daemon=True)
    opening.start()
    return opening
