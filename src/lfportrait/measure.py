"""Peak memory and machine of a run, for ``--json``; free memory, cores and disk space.

In a container, Linux' control groups (versions 1, 2 and both mixed) limit memory and cores. A
process is in a group, which is in other groups; each of them may have a limit, and the tightest one
counts. Memory that a group uses includes files that the kernel keeps in case they are read again
and drops where memory is wanted; without those that were not read lately it is the working set, by
which Kubernetes goes, too.
"""

import ctypes
import math
import os
import platform
import shutil
import sys
import time
from collections.abc import Callable, Iterator, MutableMapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TypeVar

THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS",
           "OPENCV_FOR_THREADS_NUM")
"""Environment variables that say how many threads libraries use."""

_TRIM, _PAD, _MAPPED, _ARENAS = -1, -2, -3, -8
MEMORY = {_MAPPED: 64 << 20, _TRIM: 512 << 20, _PAD: 64 << 20, _ARENAS: 1}
"""glibc's `mallopt`: arrays up to 64 MiB lie on one heap, which may keep 512 MiB that nobody uses.
As a rule each array of more than 32 MiB (at first 128 KiB) is mapped for itself and given back when
it is freed; making and zeroing these pages again each time takes a fifth of a preview."""

_Result = TypeVar("_Result")


def peak_memory_bytes() -> int:
    """Largest resident memory of this process so far, in bytes; 0 if unknown."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * 1024)


def _account(path: Path, name: str) -> str:
    """What stands behind a name, at the begin of a line, in one of Linux' accounts.

    Raises `OSError` if it can't be read, or has no such name.
    """
    for line in path.read_text("utf-8").splitlines():
        if line.startswith(name):
            return line[len(name):].lstrip(" \t:")
    raise OSError(f"no {name} in {path}")


def _status(name: str) -> int:
    """A figure of this process, in bytes."""
    return int(_account(Path("/proc/self/status"), f"{name}:").split()[0]) * 1024


def _forget_peak() -> bool:
    """Begin a new peak of this process's memory; False where that is not allowed."""
    try:
        with open("/proc/self/clear_refs", "w", encoding="utf-8") as stream:
            stream.write("5")
    except OSError:
        return False
    return True


def _peak() -> int:
    """The largest resident memory since the peak was forgotten, in bytes."""
    try:
        return _status("VmHWM")
    except OSError:
        return peak_memory_bytes()


def memory_of(function: Callable[[], _Result]) -> tuple[int, _Result]:
    """Peak memory of a call beyond that of the process, in bytes, and its result.

    The peak during the call less the resident memory before it; where the system does not report
    this (other than Linux), by how much the process's largest memory so far grew.
    """
    before = _status("VmRSS") if _forget_peak() else _peak()
    result = function()
    return max(0, _peak() - before), result


@dataclass(frozen=True)
class Cost:
    """What a call cost."""

    seconds: float  # Wall time.
    cpu_seconds: float  # Time on the cores, of all threads together.
    # Largest resident memory of the process meanwhile; since it began where only that is known.
    peak_memory_bytes: int


def cost_of(function: Callable[[], _Result]) -> tuple[Cost, _Result]:
    """Call ``function``; its cost and result."""
    start, on_cores = time.perf_counter(), time.process_time()
    _forget_peak()
    result = function()
    seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - on_cores
    return Cost(round(seconds, 3), round(cpu_seconds, 3), _peak()), result


def free_memory_bytes(system: Path = Path("/")) -> int | None:
    """Memory that a process can still get, in bytes; None if the system does not report it."""
    try:
        free = int(_account(system / "proc/meminfo", "MemAvailable:").split()[0]) * 1024
    except OSError:
        return None
    allowed = free_in_groups(system)  # a container may have less
    return max(0, free if allowed is None else min(free, allowed))


def free_disk_bytes(folder: str | os.PathLike[str]) -> int:
    """Space left for files in a folder, which need not be there yet, in bytes."""
    folder = Path(folder).absolute()
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return shutil.disk_usage(folder).free


def machine() -> dict[str, str | int]:
    """Processor and system in words, for reports."""
    name = platform.processor() or platform.machine()
    with suppress(OSError):
        name = _account(Path("/proc/cpuinfo"), "model name")
    return {"processor": name, "cores": usable_cores(), "system": platform.system(),
            "python": platform.python_version()}


def usable_cores(system: Path = Path("/")) -> int:
    """Cores that this process may use: those it may run on, or fewer where its time is limited."""
    quota = core_quota(system)
    return _cores_to_run_on() if quota is None else min(_cores_to_run_on(), quota)


def _cores_to_run_on() -> int:
    """Cores that the system may put this process on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def give_back_memory() -> None:
    """Give pages that hold nothing any more back to the system, where the C library can.

    After a field was trained these are 0.7 GB between what is kept; it takes 0.02 s.
    """
    with suppress(OSError, AttributeError, TypeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


def keep_memory() -> None:
    """Keep freed arrays' memory for later ones (`MEMORY`), unless the environment says how."""
    if any(name.startswith("MALLOC_") for name in os.environ):
        return
    with suppress(OSError, AttributeError, TypeError):  # another C library
        set_option = ctypes.CDLL(None).mallopt
        for name, value in MEMORY.items():
            set_option(name, value)


def limit_threads(environment: MutableMapping[str, str], system: Path = Path("/")) -> None:
    """Let libraries start as many threads as there are usable cores, by changing their environment.

    They know the cores of the machine and not the time that a container gets. Nothing is set where
    that is the same, nor what the user has set.
    """
    cores = usable_cores(system)
    if cores < _cores_to_run_on():
        for name in THREADS:
            environment.setdefault(name, str(cores))


_NO_LIMIT = 1 << 60  # Bytes from which version 1 means that there is no limit.
_USUAL = "/sys/fs/cgroup"


def free_in_groups(system: Path) -> int | None:
    """Memory that the process's groups still allow, in bytes; None where they set no limit."""
    left = [*(_left(group, ("memory.max", "memory.high"), "memory.current", "inactive_file")
              for group in _groups(system, "")),
            *(_left(group, ("memory.limit_in_bytes",), "memory.usage_in_bytes",
                    "total_inactive_file") for group in _groups(system, "memory"))]
    return min((value for value in left if value is not None), default=None)


def core_quota(system: Path) -> int | None:
    """Cores for which the process's groups allow time, at least 1; None where they set no limit.

    A part of a core counts as one.
    """
    shares = [*(_share_2(group) for group in _groups(system, "")),
              *(_share_1(group) for group in _groups(system, "cpu"))]
    return min((max(1, math.ceil(share)) for share in shares if share is not None), default=None)


def _left(group: Path, limits: tuple[str, ...], used: str, droppable: str) -> int | None:
    """Bytes that a group still allows."""
    found = [limit for name in limits if (limit := _number(group / name)) is not None]
    taken = _number(group / used)
    if not found or taken is None or min(found) >= _NO_LIMIT:
        return None
    with suppress(OSError, ValueError):
        taken -= int(_account(group / "memory.stat", f"{droppable} "))
    working = max(0, taken)
    return max(0, min(found) - working)


def _share_2(group: Path) -> float | None:
    """Cores of a group of version 2: time in each period, or ``max``."""
    with suppress(OSError, ValueError, IndexError, ZeroDivisionError):
        quota, period = (group / "cpu.max").read_text().split()[:2]
        return int(quota) / int(period)
    return None


def _share_1(group: Path) -> float | None:
    """Cores of a group of version 1, where -1 is no limit."""
    quota, period = (_number(group / f"cpu.cfs_{name}_us") for name in ("quota", "period"))
    return quota / period if quota and period and quota > 0 else None


def _number(path: Path) -> int | None:
    with suppress(OSError, ValueError):
        return int(path.read_text(encoding="utf-8"))
    return None


def _groups(system: Path, controller: str) -> Iterator[Path]:
    """Folders of the process's group and those around it; ``controller`` is version 1's, or ""."""
    own = _own_group(system, controller)
    for root, mount in _mounts(system, controller):
        # A container may see its own group as the root, under the name that it has outside.
        inside = own.relative_to(root) if own.is_relative_to(root) else own.relative_to("/")
        seen = [mount, *(mount.joinpath(*inside.parts[:depth + 1])
                         for depth in range(len(inside.parts)))]
        yield from (folder for folder in seen if folder.is_dir())


def _own_group(system: Path, controller: str) -> PurePosixPath:
    """The process's group as the kernel names it: ``/user.slice/job``."""
    with suppress(OSError):
        for line in (system / "proc/self/cgroup").read_text().splitlines():
            _, names, path = line.split(":", 2) if line.count(":") > 1 else ("", "-", "/")
            if controller in names.split(",") and path.startswith("/"):
                # ".." leads to groups that are not to be seen.
                parts = [part for part in PurePosixPath(path).parts if part != ".."]
                return PurePosixPath(*parts)
    return PurePosixPath("/")


def _mounts(system: Path, controller: str) -> list[tuple[PurePosixPath, Path]]:
    """Where groups are seen: the group that is the root there, and the folder."""
    found = []
    with suppress(OSError):
        for line in (system / "proc/self/mountinfo").read_text().splitlines():
            place, _, kind = line.partition(" - ")
            names, kinds = place.split(), kind.split()
            if len(names) < 5 or not kinds or kinds[0] != ("cgroup" if controller else "cgroup2"):
                continue
            if not controller or controller in kinds[-1].split(","):
                found.append((PurePosixPath(names[3]), system / names[4].lstrip("/")))
    if found:
        return found
    usual = system / _USUAL.lstrip("/")
    places = [usual / controller] if controller else [usual, usual / "unified"]
    return [(PurePosixPath("/"), place) for place in places]
