"""Temporary files and folders: their names, where they lie, and the removal of abandoned ones.

Some systems keep temporary folders (``TMPDIR``) in a small part of the memory. What other libraries
say when it is full names no folder (SQLite: "disk I/O error"), so what fails in such a folder is
said in one line here.

What is written elsewhere appears under its final name only when it is complete. Until then it has a
name beside it, ``.STEM.PROCESS-START-HOST-CHANCE.part.SUFFIX``: the number of the process that
writes, when that process started, and on which host. A process that ends by itself removes what it
has begun. One that is killed can't; the next one that comes to the folder removes it (`sweep`).
"""

import contextlib
import errno
import functools
import hashlib
import os
import platform
import re
import secrets
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import UserError

_ROOM = 1 << 20  # Bytes that are wanted before anything begins.
_FULL = 64 << 10  # Free bytes below which a folder is full: SQLite asks for more at a time.
_NUMBERS = {errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC), errno.EROFS, errno.EACCES,
            errno.EPERM, errno.EIO}
_SIGNS = ("disk i/o error", "database or disk is full", "unable to open database",
          "readonly database", "no space left on device")
"""In the messages of libraries that raise errors without numbers."""
_ADVICE = "free some space there, or set TMPDIR to a folder with more room"


@contextmanager
def temporary_folder(room: int = _ROOM) -> Iterator[Path]:
    """A new folder that is removed after the block; what a killed process left goes, too.

    The block writes ``room`` bytes at the least.
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
    """Where temporary folders go; `UserError` if there is none that can be written to."""
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
        # Said already, for files that the user named.
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


MARK = r"\d+-\d+-[0-9a-f]{8}-[0-9a-f]{8}\.part"
"""Pattern of what stands between a file's stem and its suffix in a temporary name."""
_NAME = re.compile(
    r"\.?(?P<stem>.+)\.(?P<process>\d+)-(?P<start>\d+)-(?P<host>[0-9a-f]{8})-[0-9a-f]{8}"
    r"\.(?P<kind>part|moved)(?P<suffix>\.[^.]*)?", re.DOTALL)
_LONGEST = 255  # Bytes of a file's name.
_FOREIGN = 24 * 3600.0
"""Seconds after which nobody writes any more what a process of another host has begun."""
_SWEPT: set[str] = set()
_LOCK = threading.Lock()


def part_name(path: Path, *, hidden: bool = True) -> Path:
    """A new temporary name beside a path, with its suffix, begun with a dot if ``hidden``."""
    number = os.getpid()
    mark = f".{number}-{_started(number)}-{_host()}-{secrets.token_hex(4)}.part"
    stem, room = path.stem, _LONGEST - len(os.fsencode(f".{mark}{path.suffix}"))
    if len(os.fsencode(path.name)) <= _LONGEST:  # else it is refused now, before the work
        stem = os.fsencode(stem)[:room].decode("utf-8", "ignore")
    return path.with_name(f"{'.' if hidden else ''}{stem}{mark}{path.suffix}")


def moved_name(part: Path) -> Path:
    """The name under which what a temporary file is to replace waits meanwhile."""
    *_, mark = re.finditer(MARK, part.name)
    place = mark.end() - len("part")
    return part.with_name(f"{part.name[:place]}moved{part.name[mark.end():]}")


@contextlib.contextmanager
def part_folder(path: Path) -> Iterator[Path]:
    """A new, empty folder beside a path, with a temporary name; removed after the block."""
    sweep_once(path.parent)
    folder = part_name(path)
    try:
        folder.mkdir(mode=0o700)
        yield folder
    finally:
        remove_part(folder)


def remove_part(path: Path) -> None:
    """Remove a file or a folder, if it is there and can be removed."""
    with contextlib.suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def sweep(folder: Path) -> list[str]:
    """Remove what processes that are gone have left in a folder, none in its folders; its names.

    What a living process writes stays, and so does what was begun on another host (a network drive)
    or in another container, until nothing of it has changed for a day. A file that was moved out of
    the way and whose place is empty goes back.
    """
    removed = []
    try:
        names = os.listdir(folder)
    except OSError:
        return []
    for name in names:
        found = _NAME.fullmatch(name)
        path = Path(folder, name)
        if found is None or not _abandoned(path, found):
            continue
        final = path.with_name(found["stem"] + (found["suffix"] or ""))
        if found["kind"] == "moved" and not os.path.lexists(final):
            with contextlib.suppress(OSError):
                path.rename(final)
        else:
            remove_part(path)
        if not os.path.lexists(path):
            removed.append(name)
    return removed


def sweep_once(folder: Path) -> None:
    """`sweep` a folder when this process comes to it for the first time."""
    place = os.path.abspath(folder)
    with _LOCK:
        known = place in _SWEPT
        _SWEPT.add(place)
    if not known:
        sweep(folder)


def sweep_below(folder: Path) -> None:
    """`sweep` a folder and all folders in it."""
    for place, _, _ in os.walk(folder):
        sweep(Path(place))


def _abandoned(path: Path, found: re.Match[str]) -> bool:
    """Whether nobody goes on with a temporary file."""
    if found["host"] == _host():
        return not _lives(int(found["process"]), int(found["start"]))
    return time.time() - _last_change(path) > _FOREIGN


def _last_change(path: Path) -> float:
    """When a file, or anything in a folder, was written last, in seconds since 1970."""
    try:
        times = [path.lstat().st_mtime]
        for place, _, names in os.walk(path):
            times += [os.lstat(os.path.join(place, name)).st_mtime for name in (*names, ".")]
    except OSError:  # it is being changed
        return time.time()
    return max(times)


@functools.cache
def _host() -> str:
    """What tells apart hosts, their runs, and containers, which number processes by themselves."""
    parts = [platform.node()]
    with contextlib.suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii"))
        parts.append(os.readlink("/proc/self/ns/pid"))
    return hashlib.sha256("\n".join(parts).encode("utf-8", "replace")).hexdigest()[:8]


def _lives(number: int, start: int) -> bool:
    """Whether a process of this host is there; a later one of the same number is another."""
    if sys.platform == "win32":
        return _lives_on_windows(number)
    try:
        os.kill(number, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # another user's
        pass
    now = _started(number)
    return start in (now, 0) or now == 0


@functools.lru_cache(1)
def _own_start(number: int) -> int:
    return _read_start(number)


def _started(number: int) -> int:
    """When a process started, in ticks since the host did; 0 where that is not known."""
    return _own_start(number) if number == os.getpid() else _read_start(number)


def _read_start(number: int) -> int:
    try:
        text = Path(f"/proc/{number}/stat").read_text(encoding="utf-8", errors="replace")
        state, *fields = text.rpartition(")")[2].split()
        # A process that has ended and that nobody has asked for its end yet is none.
        return -1 if state in "ZX" else int(fields[18])
    except (OSError, ValueError, IndexError):
        return 0


def _lives_on_windows(number: int) -> bool:
    if sys.platform != "win32":  # `os.kill` would end it there
        return True
    import ctypes

    kernel = ctypes.WinDLL("kernel32", use_last_error=True)
    handle = kernel.OpenProcess(0x1000, False, number)
    if not handle:
        return ctypes.get_last_error() != 87  # no such process
    code = ctypes.c_ulong()
    kernel.GetExitCodeProcess(handle, ctypes.byref(code))
    kernel.CloseHandle(handle)
    return code.value == 259
