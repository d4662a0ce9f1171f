"""What a container leaves of the machine: Linux' control groups, versions 1, 2 and both mixed.

A process is in a group, which is in other groups; each of them may have a limit, and the tightest
one counts. Memory that a group uses includes files that the kernel keeps in case they are read
again and drops where memory is wanted; without those that were not read lately it is the working
set, by which Kubernetes goes, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

__all__ = ["core_quota", "free_in_groups"]

_NO_LIMIT = 1 << 60
"""Bytes from which version 1 means that there is no limit."""
_USUAL = "/sys/fs/cgroup"


def free_in_groups(system: Path) -> int | None:
    """Memory that the process's groups still allow, in bytes; None where they set no limit.

    Parameters
    ----------
    system
        Root of the file system in which Linux keeps its accounts.
    """
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
    working = max(0, taken - _statistic(group / "memory.stat", droppable))
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


def _statistic(path: Path, name: str) -> int:
    with suppress(OSError, ValueError):
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith(f"{name} "):
                return int(line.split()[1])
    return 0


def _groups(system: Path, controller: str) -> Iterator[Path]:
    """Folders of the process's group and of those around it, as far as they are seen here.

    Parameters
    ----------
    system
        Root of the file system.
    controller
        Of version 1; "" for version 2.
    """
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
