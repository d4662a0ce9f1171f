"""Compilation as it happens: which kernels were compiled, and not found on the disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event

__all__ = ["watched_compilations"]


class _Watch(event.Listener):
    """Hears of each function of ours that Numba compiles."""

    def __init__(self, heard: Callable[[str], None]) -> None:
        self._heard = heard

    def on_start(self, event: Any) -> None:
        pass

    def on_end(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if function.__module__.startswith("lfportrait."):
            self._heard(f"{function.__module__}.{function.__qualname__}")


@contextmanager
def watched_compilations(heard: Callable[[str], None]) -> Iterator[None]:
    """Call ``heard`` with the name of each of our functions that is compiled meanwhile.

    What is read from Numba's cache on the disk is not compiled and not heard of. A function with
    several signatures comes once for each.
    """
    watch = _Watch(heard)
    event.register("numba:compile", watch)
    try:
        yield
    finally:
        event.unregister("numba:compile", watch)
