from .assembly import OpenPage, page_script, recolored, serve_page, write_page
from .config import PageConfig

__all__ = ["OpenPage", "PageConfig", "page_script", "recolored", "serve_page", "write_page"]
