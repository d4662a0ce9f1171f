"""The user's cache: keys are hashes of the producing code and of its inputs.

The same key, the same bytes, nothing to be done again. The code is the whole package, as one hash
of its files: after an update all is made again that is asked for. A method of another package adds
that package's files. Keys of stages (`lfportrait.stages`), of skins, masks, sequences and
checkpoints are made here, and so are those of what takes seconds to find and is asked for again and
again (what networks say of a painting, where a capture's face is), which is kept in the user's
cache.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import UserError
from .files import UNREADABLE_ARRAYS, atomic_write, file_state, load_arrays, temporary_home

MOST = 100  # Files that are kept of a kind: those that were used last.
_DIGITS = 32  # Of a hash.
_INSTALLATIONS = 8  # States of packages whose hashes are kept.


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name))
                for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(name): _plain(item) for name, item in sorted(value.items())}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Path):
        return str(value)
    return value


def hash_of(*parts: Any) -> str:
    """Hash of parameters (data classes, dictionaries, arrays, numbers, strings), 32 hex digits."""
    text = json.dumps([_plain(part) for part in parts], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def key_of(maker: str, *parts: Any) -> str:
    """Key of a result: hash of the code that makes it and of what it is made from, 32 hex digits.

    ``maker`` is the full name of the module that makes it (``__name__``); ``parts`` are data
    classes, dictionaries, arrays, numbers, strings, keys of other results.
    """
    return hash_of(code_of(maker.partition(".")[0]), maker, *parts)


@functools.cache
def code_of(package: str) -> str:
    """Hash of all files of our package, and of another one, or a single module, that works with it.

    Raises `KeyError` if there is no such package.
    """
    own = Path(__file__).parent
    return hash_of([_tree_hash(place) for place in dict.fromkeys((own, _place(package)))])


def _place(package: str) -> Path:
    """The folder of an installed package, or the file of a module."""
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise KeyError(package)
    return Path(spec.origin).parent if spec.submodule_search_locations else Path(spec.origin)


def _code_files(root: Path) -> list[Path]:
    """The files of a package, sorted, without what Python and Numba compile of them."""
    if root.is_file():
        return [root]
    found = []
    for folder, inner, files in os.walk(root):
        inner[:] = [name for name in inner if name != "__pycache__"]
        found += [Path(folder, name) for name in files
                  if not name.startswith((".", "warm-"))
                  and not name.endswith((".pyc", ".nbi", ".nbc"))]
    return sorted(found)


def _tree_hash(root: Path) -> str:
    """Hash of a package's files, read again only where one has another state."""
    files = _code_files(root)
    state = hash_of(root, [(file, file_state(file)) for file in files])
    kept = user_cache("code") / f"{state}.txt"
    with suppress(OSError, ValueError):
        found = kept.read_text(encoding="ascii")
        if len(found) == _DIGITS:  # else it is damaged
            return found
    found = hash_of([(file.relative_to(root.parent).as_posix(),
                      hashlib.sha256(file.read_bytes()).hexdigest()) for file in files])
    with suppress(OSError, UserError):
        with atomic_write(kept) as stream:
            stream.write(found.encode())
        _drop_oldest(kept.parent, "*.txt", _INSTALLATIONS)
    return found


def _drop_oldest(folder: Path, pattern: str, most: int) -> None:
    """Remove all but so many files, those that were used last."""
    by_age = sorted(folder.glob(pattern), key=lambda path: path.stat().st_mtime)
    for old in by_age[:-most]:
        old.unlink(missing_ok=True)


def user_cache(kind: str) -> Path:
    """The folder of the user's cache for one kind of files.

    Where the user has no home, or none that can be written to (a container), it lies in the
    temporary folder.
    """
    import pooch

    folder = Path(pooch.os_cache("lfportrait"))
    with suppress(OSError):
        if folder.is_absolute():  # it is not where nobody knows a home
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder / kind
    return temporary_home() / kind


class _Tries:
    """Files that were written in a try, and those of the try before."""

    def __init__(self) -> None:
        self.running = 0
        self.new: set[Path] = set()
        self.old: set[Path] = set()

    def seen(self, file: Path, *, written: bool) -> None:
        """A file was read or written: in a try it belongs to it, if it does to any."""
        if self.running and (written or file in self.old):
            self.new.add(file)
        elif not self.running:
            self.new.discard(file)
            self.old.discard(file)


_TRIES = _Tries()


@contextmanager
def tried() -> Iterator[None]:
    """Keep what is made in the block only until the end of the next such block.

    For inputs that somebody is changing at this moment, whose results would push out those that are
    asked for again. What is read outside such blocks meanwhile stays: the last try was kept.
    """
    if not _TRIES.running:
        _TRIES.old, _TRIES.new = _TRIES.new, set()
    _TRIES.running += 1
    try:
        yield
    finally:
        _TRIES.running -= 1
        if not _TRIES.running:
            for file in _TRIES.old - _TRIES.new:
                with suppress(OSError):
                    file.unlink(missing_ok=True)
            _TRIES.old = set()


def kept_arrays(kind: str, key: str, make: Callable[[], dict[str, NDArray[Any]]],
                folder: Path | None = None, most: int | None = None) -> dict[str, NDArray[Any]]:
    """Arrays by name that are made once, and read from the user's cache after that.

    ``key`` is a hash of all that they depend on (`key_of`). They lie in the cache's folder of this
    kind, or in ``folder``, where so many files, those that were used last, stay (`MOST` by
    default). If nothing can be written, they are made each time.
    """
    folder = folder or user_cache(kind)
    file = folder / f"{key}.npz"
    with suppress(*UNREADABLE_ARRAYS):
        arrays = load_arrays(file)
        with suppress(OSError):
            file.touch()
        _TRIES.seen(file, written=False)
        return arrays
    arrays = make()
    with suppress(OSError, UserError):
        with atomic_write(file) as stream:
            np.savez(stream, allow_pickle=False, **arrays)
        _TRIES.seen(file, written=True)
        _drop_oldest(folder, "*.npz", most or MOST)
    return arrays
