"""A request with what handlers need of it, and the table of handlers."""

import base64
import hashlib
import inspect
import json
import math
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from ...errors import UserError
from ..answers import Refusal, failed
from ..desk import Desk
from ..previews import Turn
from ..projects import Project

_SCRIPT = re.compile(rb"<script>(.*?)</script>", re.DOTALL)

Handler = Callable[["Call"], Any]


class Call:
    """One request; ``data`` is its JSON, empty for uploads and for what only reads."""

    def __init__(self, request: Request, desk: Desk, data: dict[str, Any]) -> None:
        self.request, self.desk, self.data = request, desk, data

    def word(self, name: str) -> str:
        """A part of the address: an id."""
        return str(self.request.path_params[name])

    @property
    def project(self) -> Project:
        """The project of the address."""
        return self.desk.projects.get(self.word("project"))

    @property
    def query_project(self) -> Project | None:
        """The project of the query; None where there is none."""
        name = self.request.query_params.get("project")
        return None if name is None else self.desk.projects.get(name)

    async def ask(self, name: str, facts: dict[str, Any], slot: str = "",
                  turn: Turn | None = None) -> Any:
        """The answer of the process that keeps heads in memory (`Previews.ask`).

        It is not asked when the page goes before. A body must have been read before this.
        """
        return await self.desk.previews.ask(name, facts, slot, turn, self._gone)

    async def _gone(self) -> None:
        """Wait for the end of the connection."""
        while (await self.request.receive())["type"] != "http.disconnect":
            pass  # an empty body


class Table:
    """The routes of some handlers."""

    def __init__(self) -> None:
        self._rows: list[tuple[str, str, Handler]] = []

    def add(self, method: str, path: str) -> Callable[[Handler], Handler]:
        """Have a function answer a method and a path."""
        def kept(handler: Handler) -> Handler:
            self._rows.append((method, path, handler))
            return handler

        return kept

    def routes(self, desk: Desk) -> list[Route]:
        """As Starlette takes them."""
        return [Route(path, partial(_answer, desk, handler), methods=[method])
                for method, path, handler in self._rows]


async def _answer(desk: Desk, handler: Handler, request: Request) -> Response:
    try:
        call = Call(request, desk, await _json(request))
        found = await handler(call) if inspect.iscoroutinefunction(handler) else (
            await run_in_threadpool(handler, call))
    except (Refusal, UserError, OSError) as error:
        return failed(error).answer()
    except ClientDisconnect:
        return Response(status_code=400)  # nobody reads it
    if isinstance(found, Response):
        return found
    status, body = found if isinstance(found, tuple) else (200, found)
    return JSONResponse(_finite(body), status)


def _finite(body: Any) -> Any:
    """The same with None for figures that are no numbers, which JSON has no word for."""
    if isinstance(body, dict):
        return {name: _finite(value) for name, value in body.items()}
    if isinstance(body, list | tuple):
        return [_finite(value) for value in body]
    return None if isinstance(body, float) and not math.isfinite(body) else body


async def _json(request: Request) -> dict[str, Any]:
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if request.method == "GET" or kind != "application/json":
        return {}
    try:
        found = json.loads(await request.body() or b"{}")
    except (ValueError, RecursionError) as error:
        raise Refusal("bad_request", "the request is no JSON") from error
    if not isinstance(found, dict):
        raise Refusal("bad_request", "the request must be an object")
    return found


def query_number(call: Call, name: str, default: int) -> int:
    """A whole number of the query."""
    word = call.request.query_params.get(name, str(default))
    if not (word.isascii() and word.isdigit() and len(word) < 16):
        raise Refusal("bad_request", f"{name} must be a number", field=name)
    return int(word)


def picture(call: Call, path: Path) -> Response:
    """A picture of ours; the browser keeps it as long as it is the same."""
    state = path.stat()
    tag = f'"{state.st_mtime_ns:x}-{state.st_size:x}"'
    headers = {"etag": tag, "cache-control": "private, no-cache"}
    if call.request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=headers)
    return FileResponse(path, headers=headers)


def shown_page(path: Path) -> Response:
    """A page of a head, for an iframe: its script is named by its hash, nothing else runs in it."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise Refusal("not_found", "there is no such page any more") from error
    return Response(data, media_type="text/html; charset=utf-8",
                    headers={"content-security-policy": _policy(data)})


def _policy(page: bytes) -> str:
    """What a page of a head may do."""
    hashes = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'"
        for script in _SCRIPT.findall(page))
    return (f"default-src 'none'; script-src {hashes}; "
            "style-src 'unsafe-inline'; img-src data: blob:; frame-ancestors 'self'; "
            "base-uri 'none'; form-action 'none'")


def attachment(path: Path) -> Response:
    """A file to be saved, never shown."""
    return FileResponse(path, media_type="application/octet-stream", filename=path.name,
                        content_disposition_type="attachment")
