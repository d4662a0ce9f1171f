"""The server: the page's files, the routes, the guard, and its life from begin to end.

The guard is what stands between the network and the studio. The studio listens on the loopback
address alone, but every page that is open in the browser can send requests there. So each request
must name this server exactly (a site whose name was made to point here does not), a request that
changes something must come from our own page and carry a header that no form can send, and all but
the first need the cookie that the run's token was exchanged for.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import os
import secrets
import signal
import socket
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import Request, cookie_parser
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..browsing import open_browser
from ..errors import UserError
from .answers import Refusal, failed
from .desk import Desk
from .routes import painting, showing, start

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
    """The studio as an ASGI application, behind its `Guard`."""
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
        desk.jobs.start()
        try:
            yield
        finally:
            await desk.close()

    tables = (start.TABLE, painting.TABLE, showing.TABLE)
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
    """Serve a studio until it is ended, on the loopback address; port 0 takes a free one.

    Raises `UserError` if the port is taken, or the folder can't be used. ``quiet`` does not print
    the address where the browser is opened; ``ready`` is called with it, once it can be reached.
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


HEADER = "x-lfportrait"
CSP = ("default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
       "connect-src 'self'; font-src 'self'; media-src 'self' blob:; frame-src 'self'; "
       "frame-ancestors 'none'; base-uri 'none'; form-action 'none'")
"""What the page may load: nothing but what lies here."""
_ALWAYS = {"x-content-type-options": "nosniff", "referrer-policy": "no-referrer",
           "cross-origin-opener-policy": "same-origin",
           "cross-origin-resource-policy": "same-origin", "cache-control": "no-store"}
_SAFE = ("GET", "HEAD")
_OPEN = ("/api/session",)
_BYTES = "application/octet-stream"
LARGEST = 1 << 20  # Bytes of a JSON body; what is larger is an upload, which has bounds of its own.
PATIENCE = 20.0  # Seconds in which a body must go on.


class Keys:
    """The token of a run, and the cookie that it is exchanged for.

    The cookie is named by the port: browsers give a machine's cookies to all its ports.
    """

    def __init__(self, port: int) -> None:
        self.port = port
        self.name = f"lfstudio{port}"
        self.token = secrets.token_urlsafe(32)
        self._cookie = secrets.token_urlsafe(32)

    def exchanged(self, token: str) -> dict[str, Any] | None:
        """What Starlette's ``set_cookie`` takes, for the right token."""
        if not hmac.compare_digest(token.encode(), self.token.encode()):
            return None
        return {"key": self.name, "value": self._cookie, "httponly": True, "samesite": "strict",
                "path": "/"}

    def known(self, cookie: str) -> bool:
        """Whether a cookie is this run's."""
        return hmac.compare_digest(cookie.encode(), self._cookie.encode())


class Guard:
    """The middleware that refuses.

    JSON must be there within ``patience`` seconds, and an upload must go on within them.
    """

    def __init__(self, app: ASGIApp, keys: Keys, patience: float = PATIENCE) -> None:
        self._app, self._keys, self._patience = app, keys, patience
        self._hosts = {f"{host}:{keys.port}" for host in ("127.0.0.1", "localhost", "[::1]")}
        if keys.port == 80:  # browsers leave it out
            self._hosts |= {"127.0.0.1", "localhost", "[::1]"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            if scope["type"] == "websocket":  # there are none
                await send({"type": "websocket.close", "code": 1008})
                return
            await self._app(scope, receive, send)
            return

        async def sealed(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in {**_ALWAYS, "content-security-policy": CSP}.items():
                    headers.setdefault(name, value)
            await send(message)

        try:
            limit = self._checked(scope)
        except Refusal as refusal:
            await refusal.answer()(scope, receive, sealed)
            return
        await self._app(scope, self._bounded(receive, limit), sealed)

    def _checked(self, scope: Scope) -> int | None:
        """The bytes that the body may have (None: its handler says), or a `Refusal`."""
        headers, path, method = Headers(scope=scope), str(scope["path"]), str(scope["method"])
        hosts = headers.getlist("host")
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            raise Refusal("refused", "this address is not the studio's: open the one that the "
                          "terminal printed")
        if headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
            raise Refusal("refused", "a request from another site is not answered")
        limit = self._writes(headers, hosts[0].lower()) if method not in _SAFE else 0
        needs = (path.startswith(("/api/", "/view/"))) and path not in _OPEN
        if needs and not self._keys.known(self._cookie(headers)):
            raise Refusal("no_session", "open the address that the terminal printed: it holds the "
                          "key of this run")
        return limit

    def _writes(self, headers: Headers, host: str) -> int | None:
        """Check a request that changes something."""
        origin = headers.get("origin")
        if origin is None or origin.lower() != f"http://{host}":
            raise Refusal("refused", "a request that comes from another page changes nothing")
        if headers.get(HEADER) != "1":
            raise Refusal("refused", "the request lacks the studio's own header")
        kind = headers.get("content-type", "").partition(";")[0].strip().lower()
        if kind not in ("application/json", _BYTES):
            raise Refusal("bad_type", "the studio takes JSON and application/octet-stream alone")
        length = headers.get("content-length", "")
        if not length.isascii() or not length.isdigit():
            raise Refusal("no_length", "a request must say how long it is")
        if kind == _BYTES:
            return None
        if int(length) > LARGEST:
            raise Refusal("too_large", f"{int(length)} bytes are too many; {LARGEST} are allowed")
        return LARGEST

    def _cookie(self, headers: Headers) -> str:
        return str(cookie_parser(headers.get("cookie", "")).get(self._keys.name, ""))

    def _bounded(self, receive: Receive, limit: int | None) -> Receive:
        """What receives a body that must go on, and end."""
        seen, ended, deadline = 0, False, time.monotonic() + self._patience

        async def bounded() -> Message:
            nonlocal seen, ended
            if ended:  # from here on only the end of the connection is waited for
                return await receive()
            left = self._patience if limit is None else deadline - time.monotonic()
            try:
                message = await asyncio.wait_for(receive(), max(left, 0.01))
            except TimeoutError as error:
                raise Refusal("too_slow", f"nothing came for {self._patience:g} seconds; send it "
                              "again") from error
            if message["type"] == "http.request":
                seen += len(message.get("body", b""))
                ended = not message.get("more_body", False)
                if limit is not None and seen > limit:
                    raise Refusal("too_large", f"more than {limit} bytes came")
            return message

        return bounded
