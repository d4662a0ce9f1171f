"""Folders for temporary work, where the system keeps such: ``TMPDIR``, or what stands in for it.

Some systems keep it in a small part of the memory. What other libraries say when it is full names
no folder (SQLite: "disk I/O error"), so what fails in such a folder is told in one line here.
"""

from __future__ import annotations

import errno
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import UserError
from .leftovers import part_name, remove_part, sweep_once

__all__ = ["temporary_folder", "temporary_place"]

_ROOM = 1 << 20
"""Bytes that are wanted before anything begins."""
_FULL = 64 << 10
"""Free bytes below which a folder is full: SQLite asks for more at a time."""
_NUMBERS = {errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC), errno.EROFS, errno.EACCES,
            errno.EPERM, errno.EIO}
_SIGNS = ("disk i/o error", "database or disk is full", "unable to open database",
          "readonly database", "no space left on device")
"""In the messages of libraries that raise errors without numbers."""
_ADVICE = "free some space there, or set TMPDIR to a folder with more room"


@contextmanager
def temporary_folder(room: int = _ROOM) -> Iterator[Path]:
    """A new folder that is removed after the block; what a killed process left goes, too.

    Parameters
    ----------
    room
        Bytes that the block writes at the least.

    Raises
    ------
    UserError
        If there is no such folder, it has not that room, or it is full before the block has ended.
    """
    home = temporary_place()
    sweep_once(home)
    folder = part_name(home / "lfportrait", hidden=False)
    try:
        try:
            folder.mkdir(mode=0o700)
            free = shutil.disk_usage(folder).free
        except OSError as error:
            raise UserError(f"can't write to the temporary folder {home} (TMPDIR): "
                            f"{error.strerror}; {_ADVICE}") from error
        if free < room:
            raise UserError(f"the temporary folder {home} (TMPDIR) has {_megabytes(free)} free and "
                            f"{_megabytes(room)} are needed; {_ADVICE}")
        try:
            yield folder
        except Exception as error:
            if not _by_the_folder(error, folder):
                raise
            raise UserError(f"the temporary folder {home} (TMPDIR) is full or can't be written to "
                            f"({_reason(error)}); {_ADVICE}") from error
    finally:
        remove_part(folder)


def temporary_place() -> Path:
    """Where temporary folders go.

    Raises
    ------
    UserError
        If there is none that can be written to.
    """
    try:
        return Path(tempfile.gettempdir())
    except FileNotFoundError as error:  # none of all that are tried
        raise UserError("there is no temporary folder that can be written to; "
                        "set TMPDIR to one") from error


def _reason(error: Exception) -> str:
    """What a library says, without where in its code."""
    cause = error.__cause__ if isinstance(error, UserError) else error
    return getattr(cause, "strerror", None) or str(cause).rpartition("] ")[2]


def _by_the_folder(error: Exception, folder: Path) -> bool:
    """Whether an error comes of the folder's want of room."""
    if isinstance(error, UserError):
        # Told already, for files that the user named.
        cause = error.__cause__
        return str(folder) in str(error) and isinstance(cause, OSError) and cause.errno in _NUMBERS
    if isinstance(error, OSError):
        inside = error.filename is None or Path(str(error.filename)).is_relative_to(folder)
        return error.errno in _NUMBERS and inside and (error.filename is not None or _full(folder))
    # Libraries say it in their own words, or in none.
    return any(sign in str(error).lower() for sign in _SIGNS) or (
        isinstance(error, RuntimeError) and _full(folder))


def _full(folder: Path) -> bool:
    try:
        return shutil.disk_usage(folder).free < _FULL
    except OSError:
        return True


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.1f} MB"
