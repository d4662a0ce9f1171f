"""Events for the page, and the processes that they tell of.

Events are server-sent lines, numbered, replayed to a page that comes back.
"""

from __future__ import annotations

import asyncio
import json
import threading
from collections import deque
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from .. import runner
from ..models import OFFLINE

_KEPT = 1000
_WAITING = 500  # Lines that a page may be behind; a page that does not read any more is let go.
_ALIVE = 15.0  # Seconds between two lines at least, so that both ends see a broken connection.


class Events:
    """The events of one run of the server. `tell` may be called from any thread."""

    def __init__(self) -> None:
        self.number = 0
        self._kept: deque[tuple[int, str]] = deque(maxlen=_KEPT)
        self._pages: set[asyncio.Queue[str | None]] = set()
        self._lock = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closed = False

    def tell(self, kind: str, data: Any = None, *, numbered: bool = True) -> None:
        """Tell all pages."""
        text = json.dumps({} if data is None else data, separators=(",", ":"))
        with self._lock:
            line = f"event: {kind}\ndata: {text}\n\n"
            if numbered:
                self.number += 1
                line = f"id: {self.number}\n{line}"
                self._kept.append((self.number, line))
            loop = self._loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._send, line)

    def _send(self, line: str) -> None:
        for page in list(self._pages):
            if page.qsize() >= _WAITING:
                self._pages.discard(page)
                while not page.empty():
                    page.get_nowait()
                page.put_nowait(None)
            else:
                page.put_nowait(line)

    def after(self, number: int | None) -> list[str]:
        """The lines after a number, or a reset where they are not known any more."""
        with self._lock:
            if number is None or number == self.number:
                return []
            oldest = self._kept[0][0] if self._kept else self.number + 1
            if not oldest - 1 <= number <= self.number:
                return [f"id: {self.number}\nevent: reset\ndata: {{}}\n\n"]
            return [line for count, line in self._kept if count > number]

    async def stream(self, number: int | None) -> AsyncIterator[str]:
        """The lines after a number for one page, as long as it listens.

        The number is that of the last line that it has seen; None: it has just asked for the state.
        """
        page: asyncio.Queue[str | None] = asyncio.Queue()
        with self._lock:
            self._loop = asyncio.get_running_loop()
            hello = f'event: hello\ndata: {{"event":{self.number}}}\n\n'
        # Between these two nothing is sent: the loop is ours until the next await.
        lines = self.after(number)
        self._pages.add(page)
        try:
            yield hello + "".join(lines)
            while not self._closed:
                try:
                    line = await asyncio.wait_for(page.get(), _ALIVE)
                except TimeoutError:
                    line = ": alive\n\n"
                if line is None:
                    return
                yield line
        finally:
            self._pages.discard(page)

    def close(self) -> None:
        """Let all pages go."""
        self._closed = True
        for page in list(self._pages):
            page.put_nowait(None)


class Child(runner.Child):
    """A process with a group of its own: it is paused and ended with all that it has started.

    It runs ``entry`` (``"module:serve"``); what it prints goes to ``log``.
    """

    def __init__(self, entry: str, log: Path, *, offline: bool = True) -> None:
        super().__init__(entry, log, {OFFLINE: "1"} if offline else {}, group=True)
