"""Facts of this machine for kernels: vector unit, threads, cached code, progress of compiling."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numba
from numba.core import event
from numba.core.caching import FunctionCache

from ..progress import Outlook, Progress
from .decorators import kernel_files
from .processor import features

_settings: Any = numba.config

_UNITS = (("avx512f", "AVX-512", 16), ("avx2", "AVX2", 8), ("avx", "AVX", 8), ("sve", "SVE", 4),
          ("neon", "NEON", 4), ("sse2", "SSE2", 4))
"""LLVM's feature, its name, and how many floats an instruction takes at least."""
_HALF_WRITTEN = 3600.0  # Seconds after which nobody goes on with a file of compiled code.


class KernelCache(NamedTuple):
    """Where compiled kernels are kept."""

    folder: Path | None  # What all of their folders lie in; None where none can be written.
    functions: int  # How many functions have compiled code there.
    bytes: int  # What it takes on the disk.


def vector_unit() -> tuple[str, int]:
    """The name of the vector unit that kernels use, and how many floats it takes at a time."""
    found = features()
    return next(((name, width) for feature, name, width in _UNITS if found.get(feature)),
                ("none", 1))


def thread_count() -> int:
    """Threads that kernels use."""
    return int(_settings.NUMBA_NUM_THREADS)


def kernel_cache() -> KernelCache:
    """Where compiled kernels are kept, by Numba's own choice: beside the sources, if it may."""
    package = Path(__file__).parents[1]
    homes = sorted({path.parent for path in kernel_files()})
    try:
        folders = [_cache_folder(home) for home in homes]
    except RuntimeError:  # there is none that it could write
        return KernelCache(None, 0, 0)
    files = [file for folder in folders for file in folder.glob("*.nb[ic]")]
    return KernelCache(_common(folders, package), sum(file.suffix == ".nbi" for file in files),
                       sum(file.stat().st_size for file in files))


def sweep_kernels() -> None:
    """Remove what Numba had half written when it was killed; writing takes less than a second."""
    with suppress(RuntimeError, OSError):
        for home in {path.parent for path in kernel_files()}:
            for left in _cache_folder(home).glob("*.nb[ic].tmp.*"):
                if time.time() - left.lstat().st_mtime > _HALF_WRITTEN:
                    left.unlink()


def _cache_folder(home: Path) -> Path:
    """Where Numba keeps the code of functions from the files in a folder."""
    space: dict[str, object] = {}
    # Numba asks a function for its file: this one says that it comes from there.
    exec(compile("def stranger():\n    pass", str(home / "__init__.py"), "exec"), space)
    return Path(FunctionCache(space["stranger"]).cache_path)


def _common(folders: list[Path], package: Path) -> Path:
    """The package, where all of these lie in it, else the folder in which they lie."""
    if all(folder.is_relative_to(package) for folder in folders):
        return package
    return folders[0].parent


def cache_folder() -> Path:
    """Where Numba keeps the compiled code of this folder's functions (each folder has its own)."""
    from .vectors import LANES

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
    """A `Progress` line that also shows the compilation of kernels, which takes seconds."""
    count = 0

    def heard(_: str) -> None:
        nonlocal count
        count += 1
        progress.update(progress.done, f"compiling kernels, once: {count}")

    with Progress(title, total, enabled, outlook=outlook) as progress, watched_compilations(heard):
        yield progress
