"""Hashes of photos, kept by the files' states (`lfportrait.files`), so that resuming is fast.

Where a state can't tell a change (Windows, memory cards, files that were written just now), the
photos are read again.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ...cache import hash_of
from ...errors import UserError
from ...files import file_state, tells_changes, write_json
from ..graph import source_files

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
            states = [(str(path), file_state(path)) for path in sorted(source_files(source))]
        except OSError as error:
            raise UserError(f"can't read the photos in {source}: {error.strerror}") from error
        key = hash_of(*states)
        if key in self._known:
            return self._known[key]
        found = self._compute(source)
        if all(tells_changes(state) for _, state in states):
            self._known[key] = found
        return found

    def keep(self) -> None:
        """Write what is known."""
        with suppress(UserError):
            write_json(self._file, self._known)
