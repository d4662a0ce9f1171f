"""Compilation of kernels: the cache folder, and progress of what is compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core import event

from ..progress import Outlook, Progress
from .vectors import LANES

__all__ = ["cache_folder", "compiling_progress", "watched_compilations"]


def cache_folder() -> Path:
    """Where Numba keeps the compiled code of this folder's functions (each folder has its own)."""
    return Path(LANES.exp.stats.cache_path)


class _Watch(event.Listener):
    """Hears of each function of ours that Numba compiles."""

    def __init__(self, heard: Callable[[str], None]) -> None:
        self._heard = heard

    def on_start(self, event: Any) -> None:
        pass

    def on_end(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if function.__module__.partition(".")[0].startswith("lfportrait"):
            self._heard(f"{function.__module__}.{function.__qualname__}")


@contextmanager
def watched_compilations(heard: Callable[[str], None]) -> Iterator[None]:
    """Call ``heard`` with the name of each function of this package that is compiled meanwhile.

    What is read from Numba's cache on the disk is not compiled and not heard of. A function with
    several signatures comes once for each.
    """
    watch = _Watch(heard)
    event.register("numba:compile", watch)
    try:
        yield
    finally:
        event.unregister("numba:compile", watch)


@contextmanager
def compiling_progress(title: str, total: int = 0, enabled: bool = True,
                       outlook: Outlook | None = None) -> Iterator[Progress]:
    """A progress line that also shows the compilation of kernels, which takes seconds.

    Parameters
    ----------
    title, total, enabled, outlook
        As for `Progress`.
    """
    count = 0

    def heard(_: str) -> None:
        nonlocal count
        count += 1
        progress.update(progress.done, f"compiling kernels, once: {count}")

    with Progress(title, total, enabled, outlook=outlook) as progress, watched_compilations(heard):
        yield progress
