"""Light and what files hold of it (IEC 61966-2-1: sRGB)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["linear_light"]


def linear_light(values: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Light, in [0, 1], of sRGB values in [0, 1] of any shape, float64."""
    value = np.asarray(values, np.float64)
    return np.asarray(np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4),
                      np.float64)
