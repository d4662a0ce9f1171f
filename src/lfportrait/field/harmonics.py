"""Spherical harmonics of a field's colors, in svox2's order.

The zeroth one alone: a view-independent color is 0.5 + C0 times its coefficient.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Float64

__all__ = ["C0", "real_harmonics"]

C0 = 0.28209479177387814
"""1 / (2 sqrt(pi))."""


def real_harmonics(directions: NDArray[np.floating], count: int) -> Float64:
    """The first ``count`` (1, 4 or 9) real harmonics of unit directions [N, 3], [N, count].

    The NumPy twin of `lfportrait.field.kernels.march.sh_basis`.
    """
    x, y, z = np.asarray(directions, np.float64).T
    first, second = 0.4886025119029199, 1.0925484305920792
    planes = [np.full(len(x), C0), -first * y, first * z, -first * x, second * x * y,
              -second * y * z, 0.31539156525252005 * (2 * z * z - x * x - y * y),
              -second * x * z, 0.5 * second * (x * x - y * y)]
    return np.stack(planes[:count], axis=1)
