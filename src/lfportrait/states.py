"""Whether a file is the same as before, told without reading it.

The size and the time of the last change are not enough: many programs set that time back
(``cp -p``, rsync, editors of photos). The system also notes when it last changed anything of a
file, and that nobody can set.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

__all__ = ["file_state", "tells_changes"]

_CARD = 10_000_000
"""Nanoseconds of a step of the clock of memory cards (exFAT; FAT: 2 s)."""
_SOON = 2_000_000_000
"""Nanoseconds within which two changes may have the same time."""


def file_state(path: Path) -> tuple[int, int, int, int]:
    """Size in bytes, times of change of contents and of anything (ns), and number of a file.

    Raises
    ------
    OSError
        If there is none.
    """
    return _state(path.stat())


def _state(status: os.stat_result) -> tuple[int, int, int, int]:
    return status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino


def tells_changes(state: tuple[int, int, int, int]) -> bool:
    """Whether the same state will mean the same contents.

    Not on Windows, which notes the creation instead, nor on memory cards, which note one time for
    all and in coarse steps; nor for a file that was changed only now and may be again at once.
    """
    changed = state[2]
    return (sys.platform != "win32" and changed % _CARD != 0
            and time.time_ns() - changed > _SOON)
