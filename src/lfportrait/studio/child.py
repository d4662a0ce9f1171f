"""A process of the server's, heard in the server's loop."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path
from typing import Any

from ..models import OFFLINE
from ..runner import processes

__all__ = ["Child"]


class Child(processes.Child):
    """A process that has a group of its own, from now on.

    Parameters
    ----------
    entry
        Module and function, ``"lfportrait.studio.work.jobs:serve"``.
    log
        File for what it prints.
    offline
        Whether it may ask no network for anything.
    """

    def __init__(self, entry: str, log: Path, *, offline: bool = True) -> None:
        super().__init__(entry, log, {OFFLINE: "1"} if offline else {}, group=True)
        self._messages: asyncio.Queue[Any] = asyncio.Queue()
        loop = asyncio.get_running_loop()

        def heard(message: Any) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._messages.put_nowait, message)

        self.listen(heard)

    async def tell(self, message: Any) -> None:
        """Send it a message; what it can't read any more is lost, and `hear` says so."""
        with contextlib.suppress(OSError):
            await asyncio.to_thread(self.send, message)

    async def hear(self) -> Any:
        """Its next message; None when it has ended."""
        message = await self._messages.get()
        if message is None:
            await self.end()
        return message

    async def end(self) -> None:
        """Kill it and all that it has started, and wait for its end."""
        self.kill()
        await asyncio.to_thread(self.close)
