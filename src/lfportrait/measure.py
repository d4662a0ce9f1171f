"""What a run cost: peak memory and the machine it ran on, for ``--json``."""

from __future__ import annotations

import os
import platform
import sys

__all__ = ["machine", "peak_memory_bytes"]


def peak_memory_bytes() -> int:
    """Largest resident memory of this process so far, in bytes (0 where the system can't tell)."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * 1024)


def machine() -> dict[str, str | int]:
    """Processor and system in words, for reports."""
    name = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo") as stream:
            for line in stream:
                if line.startswith("model name"):
                    name = line.split(":", 1)[1].strip()
                    break
    except OSError:
        pass
    return {"processor": name, "cores": os.cpu_count() or 1, "system": platform.system(),
            "python": platform.python_version()}
