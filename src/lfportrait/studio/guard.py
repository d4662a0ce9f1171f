"""What stands between the network and the studio.

The studio listens on the loopback address alone, but every page that is open in the browser can
send requests there. So each request must name this server exactly (a site whose name was made to
point here does not), a request that changes something must come from our own page and carry a
header that no form can send, and all but the first need the cookie that the run's token was
exchanged for.
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
import time
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .answers import Refusal

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
LARGEST = 1 << 20
"""Bytes of a JSON body; what is larger is an upload, which has bounds of its own."""
PATIENCE = 20.0
"""Seconds in which a body must go on."""


class Keys:
    """The token of a run, and the cookie that it is exchanged for.

    Parameters
    ----------
    port
        That the server listens on: browsers give a machine's cookies to all its ports, so that two
        studios need two names.
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

    Parameters
    ----------
    app
        What is guarded.
    keys
        Of the run.
    patience
        Seconds in which JSON must be there, and in which an upload must go on.
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

