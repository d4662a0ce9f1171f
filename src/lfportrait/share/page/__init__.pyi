from ..kinds import PageConfig
from .assembly import OpenPage, page_script, recolored, serve_page, write_page

__all__ = ["OpenPage", "PageConfig", "page_script", "recolored", "serve_page", "write_page"]
