"""A page shown in the browser: served on the loopback address, to this machine alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from ...browsing import open_browser
from ...errors import UserError

__all__ = ["serve_page"]


class _Handler(BaseHTTPRequestHandler):
    """Answers every request with one file, without logging."""

    def __init__(self, page: Path, *arguments: object) -> None:
        self.page = page
        super().__init__(*arguments)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        """Send the page, or that there is nothing else."""
        # A page of another site that has its name point here must not read the portrait.
        name = self.headers.get("Host", "").rsplit(":", 1)[0].lower()
        if name not in ("127.0.0.1", "localhost"):
            self.send_error(403)
            return
        if self.path.split("?")[0] not in ("/", "/portrait.html"):
            self.send_error(404)
            return
        data = self.page.read_bytes()
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        """Keep still."""


def serve_page(page: str | Path, port: int = 0, *, browse: bool = True,
               ready: Callable[[str, Callable[[], None]], None] | None = None) -> None:
    """Serve a page until interrupted.

    Parameters
    ----------
    page
        The file.
    port
        On the loopback address; 0 takes a free one.
    browse
        Open the browser there.
    ready
        Called with the address, and with what ends the serving, once it can be reached.

    Raises
    ------
    UserError
        If the port is taken or is none.
    """
    try:
        server = ThreadingHTTPServer(("127.0.0.1", port), partial(_Handler, Path(page)))
    except (OSError, OverflowError) as error:
        raise UserError(f"can't serve on port {port}: {error}; choose another --port") from error
    address = f"http://127.0.0.1:{server.server_address[1]}/"
    with server:
        if ready is not None:
            ready(address, server.shutdown)
        if browse:
            open_browser(address)
        server.serve_forever()
