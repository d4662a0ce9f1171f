from .assembly import page_script, write_page
from .config import PageConfig
from .recolored import OpenPage, recolored
from .serving import serve_page

__all__ = ["OpenPage", "PageConfig", "page_script", "recolored", "serve_page", "write_page"]
