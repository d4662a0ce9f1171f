"""The server: the page's files, the routes, the guard, and its life from begin to end."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from ..browsing import open_browser
from ..errors import UserError
from .answers import Refusal, failed
from .desk import Desk
from .guard import Guard, Keys
from .routes import making, painting, portrait, showing, start

_KINDS = {".html": "text/html; charset=utf-8", ".css": "text/css; charset=utf-8",
          ".js": "text/javascript; charset=utf-8", ".json": "application/json",
          ".svg": "image/svg+xml", ".png": "image/png", ".woff2": "font/woff2"}
_FRAME = 65536


def _files() -> dict[str, bytes]:
    """The page's files by their names below ``web/``."""
    found: dict[str, bytes] = {}

    def walk(folder: Any, name: str) -> None:
        for entry in folder.iterdir():
            path = f"{name}{entry.name}"
            if entry.is_dir():
                walk(entry, f"{path}/")
            elif Path(path).suffix in _KINDS:
                found[path] = entry.read_bytes()

    walk(resources.files(__package__) / "web", "")
    return found


def application(desk: Desk, keys: Keys, **guard: Any) -> Guard:
    """The studio as an ASGI application, behind its guard.

    Parameters
    ----------
    desk, keys
        The studio, and the keys of the run.
    guard
        Other arguments of `Guard`.
    """
    files = _files()

    def static(request: Request) -> Response:
        name = str(request.path_params.get("name", "index.html"))
        if name not in files:
            return Refusal("not_found", "there is no such page").answer()
        return Response(files[name], media_type=_KINDS[Path(name).suffix])

    async def session(request: Request) -> Response:
        body = await request.body()
        cookie = keys.exchanged(_token(body))
        if cookie is None:
            return Refusal("no_session", "this key is not of this run: open the address that the "
                           "terminal printed").answer()
        answer = JSONResponse({"ok": True})
        answer.set_cookie(**cookie)
        return answer

    async def refused(_: Request, error: Exception) -> Response:
        return failed(error).answer()

    async def missing(_: Request, error: Exception) -> Response:
        status = error.status_code if isinstance(error, HTTPException) else 404
        return Refusal("not_found", "there is no such address").answer() if status != 405 else (
            JSONResponse({"error": {"code": "bad_request", "message": "this address is asked in "
                                    "another way", "about": {}}}, 405))

    @contextlib.asynccontextmanager
    async def life(_: Starlette) -> AsyncIterator[None]:
        desk.start()
        try:
            yield
        finally:
            await desk.close()

    tables = (start.TABLE, making.TABLE, painting.TABLE, portrait.TABLE, showing.TABLE)
    routes = [Route("/", static), Route("/static/{name:path}", static),
              Route("/api/session", session, methods=["POST"]),
              *(route for table in tables for route in table.routes(desk))]
    return Guard(Starlette(routes=routes, lifespan=life, exception_handlers={
        Refusal: refused, UserError: refused, HTTPException: missing, Exception: refused}),
        keys, **guard)


def _token(body: bytes) -> str:
    import json

    try:
        found = json.loads(body or b"{}")
    except ValueError:
        return ""
    token = found.get("token") if isinstance(found, dict) else None
    return token if isinstance(token, str) else ""


class _Server(uvicorn.Server):
    """A server that says when it listens, and leaves signals to `_serve`."""

    def __init__(self, config: uvicorn.Config, ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._ready = ready

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Nothing: uvicorn would raise the signal again when it has ended."""
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self._ready()


def run(folder: Path, port: int = 0, *, browse: bool = True, quiet: bool = False,
        ready: Callable[[str], None] | None = None) -> None:
    """Serve a studio until it is ended.

    Parameters
    ----------
    folder
        Of the projects.
    port
        On the loopback address; 0 takes a free one.
    browse
        Open the browser.
    quiet
        Do not print the address, but where the browser is not opened.
    ready
        Called with the address, once it can be reached.

    Raises
    ------
    UserError
        If the port is taken, or the folder can't be used.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if os.name == "posix":  # elsewhere this would let others take the port over
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(("127.0.0.1", port))
    except (OSError, OverflowError) as error:
        listener.close()
        raise UserError(f"can't serve on port {port}: {error}; choose another --port") from error
    with listener:
        desk = Desk(folder)
        keys = Keys(listener.getsockname()[1])
        address = f"http://127.0.0.1:{keys.port}/#token={keys.token}"

        def announce() -> None:
            if not quiet or not browse:
                print(f"{address} (Ctrl-C ends)", flush=True)
            if ready is not None:
                ready(address)
            if browse:
                open_browser(address)

        config = uvicorn.Config(
            application(desk, keys), log_level="error", access_log=False, lifespan="on",
            server_header=False, date_header=False, timeout_graceful_shutdown=2, ws="none",
            http="h11", h11_max_incomplete_event_size=_FRAME, limit_concurrency=200,
            timeout_keep_alive=30, loop="asyncio")
        server = _Server(config, announce)

        def stop() -> None:
            server.should_exit = True
            desk.events.close()  # pages that listen would hold the end up

        desk.stop = stop
        _serve(server, listener, stop)


def _serve(server: _Server, listener: socket.socket, stop: Callable[[], None]) -> None:
    """Serve until a signal; Ctrl-C is the usual end, and no error."""
    async def served() -> None:
        loop = asyncio.get_running_loop()
        numbers = [signal.SIGINT, signal.SIGTERM]
        if sys.platform != "win32":
            numbers.append(signal.SIGHUP)
            for number in numbers:
                loop.add_signal_handler(number, stop)
        await server.serve([listener])

    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(served())
