"""Hashes of what a file is made from: the same key, the same bytes, nothing to be done again.

What takes seconds to find and is asked for again and again (what networks say of a painting, where
a capture's face is) is kept in the user's cache under such a hash.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import UserError
from .files import atomic_write, temporary_home
from .version import __version__

__all__ = ["code_hash", "kept_arrays", "key_of", "user_cache"]

MOST = 100
"""Files that are kept of a kind: those that were used last."""


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


def key_of(*parts: Any) -> str:
    """Hash of parameters (data classes, dictionaries, arrays, numbers, strings), 32 hex digits."""
    text = json.dumps([__version__, *(_plain(part) for part in parts)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def code_hash(*places: Path) -> str:
    """Hash of source files, and of all below folders: another version of the code, another hash."""
    files = [file for place in places
             for file in (sorted(place.rglob("*.py")) if place.is_dir() else [place])]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


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


def kept_arrays(kind: str, key: str, make: Callable[[], dict[str, NDArray[Any]]],
                folder: Path | None = None, most: int | None = None) -> dict[str, NDArray[Any]]:
    """Arrays that are made once, and read from the user's cache after that.

    Parameters
    ----------
    kind
        Folder in the user's cache.
    key
        Hash of all that the arrays depend on (`key_of`).
    make
        Makes them, where there is no file of that name.
    folder
        Instead of the user's cache.
    most
        So many files, those that were used last, stay in the folder; `MOST` by default.

    Returns
    -------
    arrays
        By name. If nothing can be written, they are made each time.
    """
    folder = folder or user_cache(kind)
    file = folder / f"{key}.npz"
    with suppress(OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        with np.load(file, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
        with suppress(OSError):
            file.touch()
        return arrays
    arrays = make()
    with suppress(OSError, UserError):
        with atomic_write(file) as stream:
            np.savez(stream, allow_pickle=False, **arrays)
        by_age = sorted(folder.glob("*.npz"), key=lambda path: path.stat().st_mtime)
        for old in by_age[:-(most or MOST)]:
            old.unlink(missing_ok=True)
    return arrays
