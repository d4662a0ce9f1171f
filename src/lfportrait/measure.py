"""Peak memory and machine of a run, for ``--json``; free memory and disk space."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import time
from collections.abc import Callable, MutableMapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from .containers import core_quota, free_in_groups

__all__ = ["THREADS", "Cost", "cost_of", "free_disk_bytes", "free_memory_bytes", "limit_threads",
           "machine", "memory_of", "peak_memory_bytes", "usable_cores"]

THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS",
           "OPENCV_FOR_THREADS_NUM")
"""Environment variables that say how many threads libraries use."""

_Result = TypeVar("_Result")


def peak_memory_bytes() -> int:
    """Largest resident memory of this process so far, in bytes; 0 if unknown."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * 1024)


def _status(name: str) -> int:
    """A figure of this process from Linux' accounts, in bytes."""
    with open("/proc/self/status", encoding="utf-8") as stream:
        for line in stream:
            if line.startswith(name + ":"):
                return int(line.split()[1]) * 1024
    raise OSError(f"no {name} in the process's status")


def memory_of(function: Callable[[], _Result]) -> tuple[int, _Result]:
    """Peak memory of a call beyond that of the process.

    Parameters
    ----------
    function
        What to call.

    Returns
    -------
    memory
        Peak during the call less the resident memory before it, in bytes; where the system does not
        report this (other than Linux), by how much the process's largest memory so far grew.
    result
        The function's.
    """
    try:
        before = _status("VmRSS")
        with open("/proc/self/clear_refs", "w", encoding="utf-8") as stream:
            stream.write("5")  # forget the peak so far
        result = function()
        return max(0, _status("VmHWM") - before), result
    except OSError:
        before = peak_memory_bytes()
        result = function()
        return peak_memory_bytes() - before, result


@dataclass(frozen=True)
class Cost:
    """What a call cost.

    Attributes
    ----------
    seconds
        Wall time.
    cpu_seconds
        Time on the cores, of all threads together.
    peak_memory_bytes
        Largest resident memory of the process meanwhile; since it began where only that is known.
    """

    seconds: float
    cpu_seconds: float
    peak_memory_bytes: int


def cost_of(function: Callable[[], _Result]) -> tuple[Cost, _Result]:
    """Call ``function``; its cost and result."""
    start, on_cores = time.perf_counter(), time.process_time()
    with suppress(OSError), open("/proc/self/clear_refs", "w", encoding="utf-8") as stream:
        stream.write("5")  # forget the peak so far
    result = function()
    seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - on_cores
    try:
        peak = _status("VmHWM")
    except OSError:
        peak = peak_memory_bytes()
    return Cost(round(seconds, 3), round(cpu_seconds, 3), peak), result


def free_memory_bytes(system: Path = Path("/")) -> int | None:
    """Memory that a process can still get, in bytes; None if the system does not report it.

    Parameters
    ----------
    system
        Root of the file system in which Linux keeps its accounts.
    """
    try:
        rows = (system / "proc/meminfo").read_text("utf-8").splitlines()
        free = next(int(row.split()[1]) * 1024 for row in rows if row.startswith("MemAvailable:"))
    except (OSError, StopIteration):
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
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as stream:
            for line in stream:
                if line.startswith("model name"):
                    name = line.split(":", 1)[1].strip()
                    break
    except OSError:
        pass
    return {"processor": name, "cores": usable_cores(), "system": platform.system(),
            "python": platform.python_version()}


def usable_cores(system: Path = Path("/")) -> int:
    """Cores that this process may use: those it may run on, or fewer where its time is limited.

    Parameters
    ----------
    system
        Root of the file system in which Linux keeps its accounts.
    """
    quota = core_quota(system)
    return _cores_to_run_on() if quota is None else min(_cores_to_run_on(), quota)


def _cores_to_run_on() -> int:
    """Cores that the system may put this process on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def limit_threads(environment: MutableMapping[str, str], system: Path = Path("/")) -> None:
    """Let libraries start as many threads as there are usable cores.

    They know the cores of the machine and not the time that a container gets. Nothing is set where
    that is the same, nor what the user has set.

    Parameters
    ----------
    environment
        Variables that libraries read when they are loaded; changed.
    system
        As for `usable_cores`.
    """
    cores = usable_cores(system)
    if cores < _cores_to_run_on():
        for name in THREADS:
            environment.setdefault(name, str(cores))
