"""Forecast of a training's time and memory, reported after its first level."""

from __future__ import annotations

import math

from ..config import Settings

__all__ = ["outlook"]

_GROWTH = 2.55
"""Lattice points grow with the resolution to this power: more than a surface, whose shell gets as
thin as its voxels only in the end. Measured: 2.2 to 2.8."""
_BYTES, _BYTES_LAID = 460, 590
"""Memory per lattice point, with given mattes and with recomputed ones."""


def outlook(config: Settings, seconds: float, count: int, laid: bool, used: int) -> str:
    """One line: lattice points at the last level, memory, and time from now on.

    Parameters
    ----------
    config
        With all defaults put in, of photos with mattes; at least two levels.
    seconds, count
        Time of the first level, and its lattice points.
    laid
        Whether mattes are recomputed.
    used
        Most memory used so far, in bytes.
    """
    first, last = config.resolutions[0], config.resolutions[-1]
    points = count * (last / first) ** _GROWTH
    memory = used + points * (_BYTES_LAID if laid else _BYTES)
    text = (f"{last} points to a head's height: up to about {points / 1e6:.1f} million in all, "
            f"{memory / 2**30:.1f} GiB")
    if config.time_budget > 0:
        return f"{text}, {config.time_budget:.0f} s as asked"
    # Beyond the processor's caches rays get slower as lattices get larger.
    speed = config.rays[0] * 1e6 / max(seconds, 1e-3)
    left = sum(rays * 1e6 / (speed * min(1.3, 0.7 * 256 / resolution))
               for rays, resolution in zip(config.rays[1:], config.resolutions[1:]))
    step = 10 ** max(0, math.floor(math.log10(max(left, 1.0))))
    return f"{text}, about {math.ceil(left / step) * step} s more"
