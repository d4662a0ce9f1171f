"""Normal equations of the camera motion that aligns a rendering with a photo."""

from __future__ import annotations

import numpy as np

from ...simd.decorators import kernel

__all__ = ["pose_equations"]


@kernel
def pose_equations(values, photo, depth, lens, usual, matrix, slope):
    """Add up one Gauss-Newton step's normal equations over a picture, Cauchy-weighted.

    A step turns the camera about its own axes by the first three numbers (radians) and moves it
    along them by the last three. Pictures' gradients are the mean of both pictures' (Malis 2004).

    Parameters
    ----------
    values, photo
        float32 [H, W, C], the rendering and the photo.
    depth
        float32 [H, W], along the optical axis in world units; pixels without one (not above zero,
        infinite) and those on the picture's border do not count.
    lens
        Focal lengths x, y and principal point x, y in pixels.
    usual
        Difference of a pixel's colors (root of the sum of squares) that is nothing unusual:
        twice as much counts half.
    matrix, slope
        float64 [6, 6] and [6], out: sum of w J'J and of w J' (photo - rendering).

    Returns
    -------
    cost, count
        Mean of Cauchy's log(1 + (difference / 2 usual)^2) over the pixels that count, and their
        number.
    """
    high, wide, channels = values.shape
    fx, fy, cx, cy = lens
    matrix[:] = 0.0
    slope[:] = 0.0
    row = np.zeros(6)
    cost, count, half = 0.0, 0, 0.25
    for y in range(1, high - 1):
        for x in range(1, wide - 1):
            z = depth[y, x]
            if not 0.0 < z < np.inf:
                continue
            u, v = (x + 0.5 - cx) / fx, (y + 0.5 - cy) / fy
            xx, xy, yy, ex, ey, size = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for c in range(channels):
                error = photo[y, x, c] - values[y, x, c]
                across = half * (values[y, x + 1, c] - values[y, x - 1, c]
                                 + photo[y, x + 1, c] - photo[y, x - 1, c])
                down = half * (values[y + 1, x, c] - values[y - 1, x, c]
                               + photo[y + 1, x, c] - photo[y - 1, x, c])
                xx += across * across
                xy += across * down
                yy += down * down
                ex += across * error
                ey += down * error
                size += error * error
            ratio = size / (4.0 * usual * usual)
            weight = 1.0 / (1.0 + ratio)
            cost += np.log(1.0 + ratio)
            count += 1
            # How the picture of the point moves: across by a, down by b for each of the six.
            a = (-fx * u * v, fx * (1.0 + u * u), -fx * v, fx / z, 0.0, -fx * u / z)
            b = (-fy * (1.0 + v * v), fy * u * v, fy * u, 0.0, fy / z, -fy * v / z)
            for i in range(6):
                slope[i] += weight * (a[i] * ex + b[i] * ey)
                row[i] = weight * (a[i] * xx + b[i] * xy)
            for i in range(6):
                along = weight * (a[i] * xy + b[i] * yy)
                for j in range(6):
                    matrix[i, j] += row[i] * a[j] + along * b[j]
    return cost / max(count, 1), count
