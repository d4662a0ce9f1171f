from .assembly import OpenPage, page_script, recolored, serve_page, write_page

__all__ = ["OpenPage", "page_script", "recolored", "serve_page", "write_page"]
