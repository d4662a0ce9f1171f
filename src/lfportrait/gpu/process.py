"""The process that holds the device, and what happens when it is lost.

A driver that resets takes its process's device with it, one that hangs takes the process. So GPU
work runs in a child (`main`), which answers one call after the other. A child that
dies or takes too long is ended and started again once; after that `GpuLostError` is raised, and the
caller computes on the CPU.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import threading
import warnings
from collections.abc import Callable, Collection
from typing import Any, TypeVar

from ..runner import Child, Pipe
from .device import Adapter, Device

_TIMEOUT = 120.0  # Seconds after which a call is taken to hang.


class GpuLostError(RuntimeError):
    """The GPU can't do it: its device was lost twice, it hung, or its memory is too small."""


class GpuProcess:
    """A child that holds one device; a call that takes ``timeout`` seconds is taken to hang.

    ``starts`` is how many times a child was started.
    """

    def __init__(self, adapter: Adapter, timeout: float = _TIMEOUT) -> None:
        self.adapter, self.timeout, self.starts = adapter, timeout, 0
        self._child: Child | None = None
        self._held: dict[str, frozenset[str]] = {}
        self._lock = threading.RLock()
        self._lost = False

    def holds(self, kind: str, name: str) -> bool:
        """Whether the child that runs now keeps something under this name (`note`)."""
        return (self._child is not None and self._child.alive and name in self._held.get(kind, ()))

    def note(self, kind: str, names: Collection[str]) -> None:
        """Remember what of a kind the child keeps now."""
        self._held[kind] = frozenset(names)

    def call(self, name: str, *arguments: Any) -> Any:
        """Call ``"package.module:function"`` in the child, with the `Device` and the arguments.

        These, and what it returns, are arrays, numbers, text, and what can be pickled of them.
        Raises `GpuLostError` if the child was lost; a later call starts another one, unless that
        was lost, too.
        """
        with self._lock:
            if self._lost:
                raise GpuLostError(f"{self.adapter.title} was lost twice")
            child = self._running()
            timer = threading.Timer(self.timeout, child.kill)
            timer.daemon = True
            timer.start()
            try:
                child.send((name, arguments))
                good, result = child.receive()
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
        if child is not None:
            child.close()

    def _running(self) -> Child:
        if self._child is None or not self._child.alive:
            self.close()
            self.starts += 1
            self._child = Child("lfportrait.gpu.process:main")
            with contextlib.suppress(OSError):
                self._child.send(self.adapter)
        return self._child


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


def _answer(device: Device, name: str, arguments: tuple[Any, ...]) -> tuple[bool, Any]:
    """What a call returns, or the error that it raised."""
    module, function = name.split(":")
    try:
        return True, getattr(importlib.import_module(module), function)(device, *arguments)
    except MemoryError as error:
        return False, GpuLostError(f"{device.adapter.title} has too little memory: {error}")
    except Exception as error:
        text, kind = str(error), type(error)
        if kind.__name__ == "GPUOutOfMemoryError" or any(
                words in text.lower() for words in ("out of memory", "not enough memory")):
            return False, GpuLostError(f"{device.adapter.title} has too little memory")
        if "lost" in text.lower():
            return False, GpuLostError(f"{device.adapter.title} was lost")
        if kind.__module__.split(".")[0] in ("builtins", "lfportrait"):
            return False, error
        # The parent need not have the module that this error is from.
        return False, RuntimeError(f"{kind.__name__}: {text}")


def main() -> None:
    """Answer calls until the parent is gone."""
    pipe = Pipe()
    adapter = pipe.requests.get()
    try:
        device = Device(adapter)
    except Exception as error:
        pipe.requests.get()
        pipe.tell(False, GpuLostError(f"{adapter.title} can't be used: {error}"))
        return
    while True:
        pipe.tell(*_answer(device, *pipe.requests.get()))
