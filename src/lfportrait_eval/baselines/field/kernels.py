"""RMSProp steps on colors."""

from __future__ import annotations

import numpy as np

from lfportrait.simd.decorators import lean_kernel
from lfportrait.simd.threads import shared


@shared("colors")
@lean_kernel
def rmsprop_step(since, until, colors, gradient, square, rate):
    """RMSProp as in svox2 on colors [N, 3] with gradient [3, N], where it is not zero.

    A color's first slope is its own mean square. Colors stay in [0, 1]; the gradient is set to
    zero.
    """
    keep = np.float32(0.95)
    for row in range(since, until):
        for channel in range(3):
            slope = gradient[channel, row]
            if slope != 0:
                mean = slope * slope
                if square[row, channel] != 0:
                    mean += keep * (square[row, channel] - mean)
                square[row, channel] = mean
                value = colors[row, channel] - rate * slope / (np.sqrt(mean) + np.float32(1e-20))
                colors[row, channel] = min(max(value, np.float32(0)), np.float32(1))
                gradient[channel, row] = np.float32(0)
