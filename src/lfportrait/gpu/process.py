"""The process that holds the device, and what happens when it is lost.

A driver that resets takes its process's device with it, one that hangs takes the process. So GPU
work runs in a child (`lfportrait.gpu.worker`), which answers one call after the other over its
standard input and output. A child that dies or takes too long is ended and started again once;
after that `GpuLostError` is raised, and the caller computes on the CPU.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import pickle
import struct
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Collection
from typing import IO, Any, TypeVar

from .adapters import Adapter

__all__ = ["GpuLostError", "GpuProcess", "attempted", "gpu_process", "receive", "send"]

_TIMEOUT = 120.0
"""Seconds after which a call is taken to hang."""


class GpuLostError(RuntimeError):
    """The GPU can't do it: its device was lost twice, it hung, or its memory is too small."""


def send(stream: IO[bytes], value: Any) -> None:
    """Write an object; arrays follow it as they are, without a copy."""
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    parts = [part.raw() for part in buffers]
    sizes = [len(head), *(part.nbytes for part in parts)]
    everything: list[Any] = [struct.pack(f"<Q{len(sizes)}Q", len(sizes), *sizes), head, *parts]
    for part in everything:
        view = memoryview(part)
        while len(view):
            view = view[stream.write(view):]
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """Read an object that `send` wrote.

    Raises
    ------
    EOFError
        If the other side is gone.
    """
    (count,) = struct.unpack("<Q", _exactly(stream, 8))
    sizes = struct.unpack(f"<{count}Q", _exactly(stream, 8 * count))
    head = _exactly(stream, sizes[0])
    return pickle.loads(head, buffers=[_exactly(stream, size) for size in sizes[1:]])


def _exactly(stream: IO[bytes], size: int) -> bytearray:
    """So many bytes, in memory that arrays may write to."""
    out = bytearray(size)
    view, got = memoryview(out), 0
    while got < size:
        more = stream.readinto(view[got:])  # type: ignore[attr-defined]
        if not more:
            raise EOFError("the stream ended")
        got += more
    return out


def _widen(stream: IO[bytes]) -> None:
    """Let a pipe hold more at once, where the system can: pictures take half the time."""
    with contextlib.suppress(ImportError, AttributeError, OSError):
        import fcntl

        fcntl.fcntl(stream.fileno(), fcntl.F_SETPIPE_SZ, 1 << 20)


class GpuProcess:
    """A child that holds one device.

    Parameters
    ----------
    adapter
        The adapter that it uses.
    timeout
        Seconds after which a call is taken to hang.

    Attributes
    ----------
    adapter
        As above.
    starts
        How many times a child was started.
    """

    def __init__(self, adapter: Adapter, timeout: float = _TIMEOUT) -> None:
        self.adapter, self.timeout, self.starts = adapter, timeout, 0
        self._child: subprocess.Popen[bytes] | None = None
        self._held: dict[str, frozenset[str]] = {}
        self._lock = threading.RLock()
        self._lost = False

    def holds(self, kind: str, name: str) -> bool:
        """Whether the child that runs now keeps something under this name (`note`)."""
        return (self._child is not None and self._child.poll() is None
                and name in self._held.get(kind, ()))

    def note(self, kind: str, names: Collection[str]) -> None:
        """Remember what of a kind the child keeps now."""
        self._held[kind] = frozenset(names)

    def call(self, name: str, *arguments: Any) -> Any:
        """Call a function in the child.

        Parameters
        ----------
        name
            ``"package.module:function"``; it is given the `Device`, then the arguments.
        arguments
            Arrays, numbers, text, and what can be pickled of them.

        Returns
        -------
        result
            What it returned.

        Raises
        ------
        GpuLostError
            If the child was lost; a later call starts another one, unless that was lost, too.
        """
        with self._lock:
            if self._lost:
                raise GpuLostError(f"{self.adapter.title} was lost twice")
            child = self._running()
            timer = threading.Timer(self.timeout, child.kill)
            timer.daemon = True
            timer.start()
            try:
                assert child.stdin is not None and child.stdout is not None
                send(child.stdin, (name, arguments))
                good, result = receive(child.stdout)
            except (OSError, EOFError) as error:
                slow = timer.finished.is_set()
                self.close()
                self._lost = self.starts > 1
                why = f"did not answer within {self.timeout:g} s" if slow else "was lost"
                raise GpuLostError(f"{self.adapter.title} {why}") from error
            except BaseException:
                self.close()  # an answer is under way that nobody will read
                raise
            finally:
                timer.cancel()
        if good:
            return result
        if isinstance(result, GpuLostError):
            self.close()
        raise result

    def close(self) -> None:
        """End the child."""
        child, self._child = self._child, None
        self._held.clear()
        if child is None:
            return
        child.kill()
        child.wait()
        for stream in (child.stdin, child.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()

    def _running(self) -> subprocess.Popen[bytes]:
        if self._child is not None and self._child.poll() is None:
            return self._child
        self.close()
        self.starts += 1
        paths = os.pathsep.join(path for path in sys.path if path)
        child = subprocess.Popen(
            [sys.executable, "-m", "lfportrait.gpu.worker"], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, bufsize=0, env={**os.environ, "PYTHONPATH": paths})
        self._child = child
        assert child.stdin is not None and child.stdout is not None
        for stream in (child.stdin, child.stdout):
            _widen(stream)
        with contextlib.suppress(OSError):
            send(child.stdin, self.adapter)
        return child


_processes: dict[Adapter, GpuProcess] = {}

Result = TypeVar("Result")


def attempted(adapter: Adapter | None, work: Callable[[GpuProcess], Result]) -> Result | None:
    """What work on a GPU gives; None, and a warning, where it was lost, or without an adapter.

    The caller computes on the CPU then.
    """
    if adapter is None:
        return None
    try:
        return work(gpu_process(adapter))
    except GpuLostError as error:
        warnings.warn(f"{error}: the CPU computes instead", stacklevel=3)
        return None


def gpu_process(adapter: Adapter) -> GpuProcess:
    """The process of an adapter, started when it is first called and ended with this one."""
    if adapter not in _processes:
        _processes[adapter] = GpuProcess(adapter)
        atexit.register(_processes[adapter].close)
    return _processes[adapter]
