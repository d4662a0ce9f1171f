"""The child's end of the pipe between the server and its processes.

Pickled requests come on standard input, pickled answers go to standard output; only a server and
its own processes talk this way. When the server is gone, however it ended, standard input ends, and
so do this process and those that it started.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import pickle
import queue
import signal
import struct
import sys
import threading
from typing import Any, BinaryIO

__all__ = ["Pipe", "framed"]

_WOKEN_BY = 1
"""Linux: prctl's number for the signal that a process gets when its parent ends."""


def framed(message: Any) -> bytes:
    """A message with its length before it."""
    data = pickle.dumps(message)
    return struct.pack("<I", len(data)) + data


class Pipe:
    """The pipe to the server. `tell` may be called from any thread.

    What libraries print goes to the log, where standard error is already.
    """

    def __init__(self) -> None:
        _end_with_parent()
        self._answers: BinaryIO = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)
        self._lock = threading.Lock()
        self.requests: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        try:
            while head := sys.stdin.buffer.read(4):
                data = sys.stdin.buffer.read(struct.unpack("<I", head)[0])
                self.requests.put(pickle.loads(data))
        except (EOFError, OSError, struct.error, pickle.UnpicklingError):
            pass
        _end()

    def tell(self, *message: Any) -> None:
        """Send a message."""
        data = framed(message)
        with self._lock:
            try:
                self._answers.write(data)
                self._answers.flush()
            except OSError:
                _end()


def _end() -> None:
    """End this process and those that it started, at once."""
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _end_with_parent() -> None:
    """Linux: a process that is paused goes on when its parent has ended, and finds the pipe ended.

    Elsewhere the system itself wakes and ends paused processes that nobody could wake any more.
    """
    if sys.platform != "linux":
        return
    parent = os.getppid()
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_WOKEN_BY, signal.SIGCONT)
    if os.getppid() != parent:
        _end()
