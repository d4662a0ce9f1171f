"""Hot loops of the guides: moving least squares and the Gaussian blur of the appearance guide.

Moving least squares with similarities (Schaefer et al. 2006) in complex numbers: for a point v, the
map f(z) = a (z - p*) + q* that minimises sum_i |f(p_i) - q_i|^2 / |p_i - v|^2 has
a = sum w conj(p_i - p*) (q_i - q*) / sum w |p_i - p*|^2, with p*, q* the weighted means. It is read
off five weighted sums, so a point costs one pass over the control points.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["blur_rows", "mls_points", "resample_grid"]


@numba.njit(cache=True, parallel=True)
def mls_points(points, sources, targets, weights, softness, out):
    """Map ``points`` [N, 2] by moving least squares (similarity) into ``out`` [N, 2], float64.

    ``sources`` and ``targets`` [M, 2] are the control points, ``weights`` [M] their importance;
    ``softness`` [M] is added to their squared distance: above 0 they attract but do not pin.
    """
    for n in numba.prange(points.shape[0]):
        vx, vy = points[n, 0], points[n, 1]
        total = px = py = qx = qy = square = real = imaginary = 0.0
        hit = -1
        for m in range(sources.shape[0]):
            # Coordinates relative to v keep the moments small, hence accurate.
            ax, ay = sources[m, 0] - vx, sources[m, 1] - vy
            bx, by = targets[m, 0] - vx, targets[m, 1] - vy
            distance = ax * ax + ay * ay
            near = distance + softness[m]
            if near < 1e-12:
                hit = m
                break
            w = weights[m] / near
            total += w
            px += w * ax
            py += w * ay
            qx += w * bx
            qy += w * by
            square += w * distance
            real += w * (ax * bx + ay * by)
            imaginary += w * (ax * by - ay * bx)
        if hit >= 0:
            out[n, 0], out[n, 1] = targets[hit, 0], targets[hit, 1]
            continue
        px, py, qx, qy = px / total, py / total, qx / total, qy / total
        spread = square / total - (px * px + py * py)
        if spread > 1e-12:
            real = (real / total - (px * qx + py * qy)) / spread
            imaginary = (imaginary / total - (px * qy - py * qx)) / spread
        else:
            real, imaginary = 1.0, 0.0
        out[n, 0] = vx + qx - (real * px - imaginary * py)
        out[n, 1] = vy + qy - (real * py + imaginary * px)


@numba.njit(cache=True, parallel=True)
def resample_grid(nodes, spacing, out):
    """Bilinear interpolation of grid values to pixels.

    ``nodes`` [h, w, C] lie at pixel (i * spacing); ``out`` [H, W, C] float32 is filled.
    """
    height, width, channels = out.shape
    for y in numba.prange(height):
        j = min(y // spacing, nodes.shape[0] - 2)
        fy = np.float32((y - j * spacing) / spacing)
        for x in range(width):
            i = min(x // spacing, nodes.shape[1] - 2)
            fx = np.float32((x - i * spacing) / spacing)
            for c in range(channels):
                top = nodes[j, i, c] + fx * (nodes[j, i + 1, c] - nodes[j, i, c])
                low = nodes[j + 1, i, c] + fx * (nodes[j + 1, i + 1, c] - nodes[j + 1, i, c])
                out[y, x, c] = top + fy * (low - top)


@numba.njit(cache=True, parallel=True, fastmath=True)
def blur_rows(image, taps, out):
    """Convolve the columns of ``image`` [H, W] float32 with the symmetric ``taps`` [2 r + 1].

    The border is mirrored. A whole row is accumulated at a time, so the loop over x vectorises.
    """
    height, width = image.shape
    radius = taps.shape[0] // 2
    for y in numba.prange(height):
        row = np.zeros(width, np.float32)
        for k in range(-radius, radius + 1):
            j = y + k
            while j < 0 or j >= height:
                j = -j - 1 if j < 0 else 2 * height - 1 - j
            weight = taps[k + radius]
            for x in range(width):
                row[x] += weight * image[j, x]
        for x in range(width):
            out[y, x] = row[x]
