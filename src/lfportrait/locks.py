"""Locks on files: one process at a time where several would write to one folder."""

from __future__ import annotations

import errno
from typing import IO

__all__ = ["lock"]


def lock(stream: IO[bytes], wait: bool = False) -> None:
    """Lock an open file for this process; the lock ends with the stream, or with the process.

    Network drives without locks leave it unlocked.

    Parameters
    ----------
    stream
        Open for writing.
    wait
        Wait until no other process has the lock.

    Raises
    ------
    BlockingIOError
        If another process has it and is not waited for.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        how = msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK  # type: ignore[attr-defined]
        try:
            msvcrt.locking(stream.fileno(), how, 1)  # type: ignore[attr-defined]
        except OSError as error:
            raise BlockingIOError(*error.args) from error
    else:
        try:
            fcntl.flock(stream.fileno(), fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:
            if error.errno in (errno.EACCES, errno.EAGAIN):
                raise BlockingIOError(*error.args) from error
            if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.EINVAL, errno.ENOSYS):
                raise
