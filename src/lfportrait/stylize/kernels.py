"""Hot loops of the stylisation, in Numba: from colors to a view and back, and steps of Adam.

These are products with a view's sparse weights.
"""

import numpy as np

from ..simd.decorators import lean_kernel
from ..simd.threads import shared


@shared("out")
@lean_kernel
def gather_colors(since, until, indptr, rows, weights, colors, out):
    """Out [P, 3] = weights times colors [N, 3] (CSR)."""
    for pixel in range(since, until):
        red, green, blue = np.float32(0), np.float32(0), np.float32(0)
        for entry in range(indptr[pixel], indptr[pixel + 1]):
            weight, row = weights[entry], rows[entry]
            red += weight * colors[row, 0]
            green += weight * colors[row, 1]
            blue += weight * colors[row, 2]
        out[pixel, 0], out[pixel, 1], out[pixel, 2] = red, green, blue


@shared("image")
@lean_kernel
def scatter_colors(since, until, indptr, rows, weights, image, out):
    """Out [C, N] += transposed weights times image [C, P].

    One channel a thread, each in scan order: the sums do not depend on the threads.
    """
    for channel in range(since, until):
        for pixel in range(len(indptr) - 1):
            value = image[channel, pixel]
            if value != 0:
                for entry in range(indptr[pixel], indptr[pixel + 1]):
                    out[channel, rows[entry]] += weights[entry] * value


@shared("colors")
@lean_kernel
def adam_step(since, until, colors, gradient, mean, square, rate, step):
    """Adam on colors [N, 3] with gradient [3, N], for rows whose gradient is not zero.

    Colors stay in [0, 1]; the gradient is set to zero.
    """
    first, second = np.float32(0.9), np.float32(0.99)
    unbias = np.float32(1.0 - 0.9 ** step)
    unbias_square = np.float32(1.0 - 0.99 ** step)
    for row in range(since, until):
        for channel in range(3):
            slope = gradient[channel, row]
            if slope != 0:
                mean[row, channel] = first * mean[row, channel] + (1 - first) * slope
                square[row, channel] = second * square[row, channel] + (1 - second) * slope * slope
                change = (mean[row, channel] / unbias) / (
                    np.sqrt(square[row, channel] / unbias_square) + np.float32(1e-12))
                value = colors[row, channel] - rate * change
                colors[row, channel] = min(max(value, np.float32(0)), np.float32(1))
                gradient[channel, row] = np.float32(0)
