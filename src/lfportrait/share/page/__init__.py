"""The whole portrait in one HTML file that anybody can open, and any panel can show.

`write_page` writes it: `colors` says which colors can be shown, `packing` makes a few megabytes of
the field, `budget` keeps to the size that is asked for, `poster` is the picture that shows at once,
`assembly` joins all with the page's script in `web/`; `serving` shows it in a browser. See
docs/portrait-page.md for what the page does. `recolored` gives a page that is open other colors.
"""

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .assembly import page_script, write_page
    from .config import PageConfig
    from .recolored import OpenPage, recolored
    from .serving import serve_page

__all__ = ["OpenPage", "PageConfig", "page_script", "recolored", "serve_page", "write_page"]

__getattr__, __dir__ = attach(__name__, __file__)
