"""Hashes of photos, cached by file size and time, so that resuming is fast."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ...cache import hash_of
from ...errors import UserError
from ...files import write_json
from ..steps import source_files

__all__ = ["Fingerprints"]


class Fingerprints:
    """Hash of a sitter's photos, from the file of those that are known or computed.

    Parameters
    ----------
    file
        Where they are kept.
    compute
        The hash of a folder or file by its contents.
    """

    def __init__(self, file: Path, compute: Callable[[Path], str]) -> None:
        self._file, self._compute = file, compute
        self._known: dict[str, str] = {}
        with suppress(OSError, ValueError):
            self._known = dict(json.loads(file.read_text(encoding="utf-8")))

    def __call__(self, source: Path) -> str:
        """The hash of a sitter's photos.

        Raises
        ------
        UserError
            If one can't be read.
        """
        try:
            states = [(str(path), state.st_size, state.st_mtime_ns)
                      for path in sorted(source_files(source)) for state in [path.stat()]]
        except OSError as error:
            raise UserError(f"can't read the photos in {source}: {error.strerror}") from error
        key = hash_of(*states)
        if key not in self._known:
            self._known[key] = self._compute(source)
        return self._known[key]

    def keep(self) -> None:
        """Write what is known."""
        with suppress(UserError):
            write_json(self._file, self._known)
