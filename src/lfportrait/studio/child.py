"""A process of the server's: started, asked, paused and ended with all that it has started.

It has a process group of its own, so that Ctrl-C in the terminal does not reach it and it can be
paused and ended as a whole.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import pickle
import signal
import struct
import sys
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..models import OFFLINE
from .work.pipe import framed

__all__ = ["CAN_PAUSE", "Child"]

CAN_PAUSE = hasattr(os, "killpg")
"""Whether this system can stop a process and all that it has started, and let it go on."""


class Child:
    """One process.

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
        self._entry, self._log = entry, log
        self._settings = {OFFLINE: "1"} if offline else {}
        self._process: asyncio.subprocess.Process | None = None
        self.paused = False
        self._ended = False
        self._reading = False

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self._process is not None and self._process.returncode is None

    @property
    def number(self) -> int:
        """Of the process; 0 where there is none."""
        return self._process.pid if self._process is not None and self.alive else 0

    async def start(self) -> None:
        """Start it."""
        module, _, function = self._entry.partition(":")
        own: dict[str, Any] = {"process_group": 0} if os.name == "posix" else {
            "creationflags": 0x200}  # CREATE_NEW_PROCESS_GROUP
        self._log.parent.mkdir(parents=True, exist_ok=True)
        keep = self._log.is_file() and self._log.stat().st_size < 1 << 20
        with open(self._log, "ab" if keep else "wb") as log:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable, "-c", f"from {module} import {function}; {function}()",
                stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=log,
                env={**os.environ, **self._settings}, **own)

    async def send(self, message: Any) -> None:
        """Send it a message; what it can't read any more is lost, and `receive` says so."""
        assert self._process is not None and self._process.stdin is not None
        with contextlib.suppress(ConnectionError):
            self._process.stdin.write(framed(message))
            await self._process.stdin.drain()

    async def receive(self) -> Any:
        """Its next message; None when it has ended."""
        assert self._process is not None and self._process.stdout is not None
        self._reading = True
        try:
            size = struct.unpack("<I", await self._process.stdout.readexactly(4))[0]
            return pickle.loads(await self._process.stdout.readexactly(size))
        except (asyncio.IncompleteReadError, ConnectionError, pickle.UnpicklingError):
            self._reading = False
            await self.end()
            return None
        finally:
            self._reading = False

    def pause(self, paused: bool) -> None:
        """Stop it where it is, or let it go on; its memory stays.

        Raises
        ------
        UserError
            On systems that can't.
        """
        if not CAN_PAUSE:
            raise UserError("this system can't pause a process; cancel the job instead: it goes on "
                            "where its last stage ended")
        self._signal(signal.SIGSTOP if paused else signal.SIGCONT)
        self.paused = paused

    def kill(self) -> None:
        """Kill it and all that it has started."""
        if self._process is None or self._ended:
            return
        self._ended = True
        if hasattr(os, "killpg"):
            self._signal(signal.SIGKILL)
        elif self.alive:
            self._process.kill()

    async def end(self) -> None:
        """Kill it and all that it has started, and wait for its end."""
        self.kill()
        if self._process is None:
            return
        await self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()
        if self._process.stdout is not None and not self._reading:
            # Read to its end, the pipe is closed before the loop is.
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._process.stdout.read(), 1.0)

    def _signal(self, number: int) -> None:
        assert self._process is not None
        # Where the process itself is gone, the group may still have members.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, number)
