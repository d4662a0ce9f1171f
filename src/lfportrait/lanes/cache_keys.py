"""Stable identities, in every process, for functions made by a factory, so that caching works.

Numba finds a function's compiled code on disk by a hash of its bytecode and of a pickle of what it
closes over. Another compiled function among the latter counts by a random identity; a type, by what
was asked of it so far; a string that comes twice, by whether it is one object. So code of a
factory's function is hardly ever found again. Here such functions get an identity from their names,
the factory's parameters and the kernels' sources, and are found by it alone; an edit of any kernel
recompiles all of them.

The identity becomes part of the function's name, too. Numba distinguishes functions of one name by
the order in which a process compiled them, and code that comes from the disk keeps the number of
the process that wrote it: two products of a factory could bear one symbol, and the linker would
take either for both. Their files on the disk differ for the same reason.

Processes that compile one function for other types at the same time would both take the next number
for their code: one's would be found under the other's types. So they add to a function's files one
after the other.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import uuid
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import Any

from numba.core.caching import FunctionCache, IndexDataCacheFile

from ..files import lock

__all__ = ["identified", "identified_all", "identity", "kernel_sources", "shared_files"]

_LOCK = "kernels.lock"
"""A file beside compiled code, locked while some is added."""
_PATIENCE = 2.0
"""Seconds to wait for another process: one that is paused just then must not hold up all others."""


@functools.cache
def kernel_sources() -> str:
    """Hash of the sources of all kernels: the stages' and the lanes they are made of."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted([*package.glob("lanes/*.py"), *package.rglob("kernels/*.py"),
                        *package.rglob("kernels.py")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def identity(function: Any) -> str:
    """The identity of a compiled function, to make others' from it."""
    return str(getattr(function, "_uuid", ""))


class _SharedFiles(IndexDataCacheFile):
    """Numba's files of a function, to which one process adds at a time."""

    def save(self, key: Any, data: Any) -> None:
        with contextlib.ExitStack() as stack:
            # Without a lock, or with another process's, the file is written all the same.
            with contextlib.suppress(OSError):
                stack.callback(lock(Path(self._cache_path) / _LOCK, _PATIENCE).release)
            super().save(key, data)


def shared_files(function: Any) -> Any:
    """The same compiled function, to whose files on the disk one process adds at a time."""
    cache = getattr(function, "_cache", None)
    if isinstance(cache, FunctionCache):
        cache._cache_file = _SharedFiles(cache.cache_path, cache._impl.filename_base,
                                         cache._impl.locator.get_source_stamp())
    return function


class _CacheByIdentity(FunctionCache):
    """Numba's cache of a function on the disk, whose key is the function's identity."""

    def __init__(self, function: FunctionType, number: str) -> None:
        super().__init__(function)
        self._number = number

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        return sig, codegen.magic_tuple(), self._number


def identified(*parts: Any) -> Callable[[Any], Any]:
    """Decorate a factory's compiled function (outermost) with an identity made of ``parts``.

    Parameters
    ----------
    parts
        Identity of the function: its name, and all arguments of the factory.
    """
    def set_identity(function: Any) -> Any:
        name = repr((kernel_sources(), *parts))
        # Of a namespace's entries only compiled functions have a place in Numba's cache.
        if hasattr(function, "_set_uuid"):
            number = str(uuid.uuid5(uuid.NAMESPACE_OID, name))
            function._set_uuid(number)
            if hasattr(function, "py_func"):
                function.py_func.__qualname__ += f"_{number.replace('-', '')[:12]}"
                if isinstance(function._cache, FunctionCache):
                    function._cache = _CacheByIdentity(function.py_func, number)
                    shared_files(function)
        return function
    return set_identity


def identified_all(name: str, width: int, functions: SimpleNamespace) -> None:
    """Give the functions of a namespace identities from its name, its width and theirs."""
    known: set[int] = set()
    for key, function in vars(functions).items():
        # A function under two names keeps its first identity.
        if key not in ("width", "jit") and id(function) not in known:
            known.add(id(function))
            identified(name, width, key)(function)
