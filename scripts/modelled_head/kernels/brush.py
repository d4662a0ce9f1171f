"""Brush strokes: tracing their paths along a direction field and laying them on a canvas.

Paths follow Hertzmann ("Painterly rendering with curved brush strokes of multiple sizes", 1998):
a stroke starts where the canvas differs most from the reference inside a cell, takes its color
there, and goes on along the field until the canvas would be better without it. A stroke is laid
with bristles: across its width, each bristle carries more or less paint, which also runs out along
the way. The thickness of the paint is kept beside the color, so that light can rake over it.
"""

from __future__ import annotations

from math import exp, sqrt

import numpy as np

from lfportrait.simd.decorators import kernel, lean

from .implicit import noise

__all__ = ["lay", "plan", "trace"]


@lean
def _apart(a, y, x, color):
    """Squared distance between picture ``a`` at (y, x) and a color."""
    r, g, b = a[y, x, 0] - color[0], a[y, x, 1] - color[1], a[y, x, 2] - color[2]
    return r * r + g * g + b * b


@lean
def _walk(path, field, label, reference, canvas, x, y, radius, shortest, longest, bend, fit):
    """Trace one stroke from (x, y) into ``path`` [P, 2]; returns its number of points.

    Only one that is to ``fit`` ends where the canvas is nearer, once it is longer than
    ``shortest``. Callers give no constants: each would have code of its own.
    """
    height, width = label.shape
    row, column = int(y), int(x)
    color = (reference[row, column, 0], reference[row, column, 1], reference[row, column, 2])
    home = label[row, column]
    path[0, 0], path[0, 1] = x, y
    count, dx, dy = 1, 0.0, 0.0
    for _ in range(longest):
        fx, fy = field[row, column, 0], field[row, column, 1]
        if fx * dx + fy * dy < 0.0:
            fx, fy = -fx, -fy
        if count > 1:
            fx, fy = bend * fx + (1.0 - bend) * dx, bend * fy + (1.0 - bend) * dy
        size = sqrt(fx * fx + fy * fy)
        if size < 1e-6:
            break
        dx, dy = fx / size, fy / size
        x, y = x + radius * dx, y + radius * dy
        if x < 0.0 or y < 0.0 or x >= width or y >= height:
            break
        row, column = int(y), int(x)
        if label[row, column] != home and count >= 2:
            break
        if fit and count > shortest:
            mine = _apart(reference, row, column, color)
            r = reference[row, column, 0] - canvas[row, column, 0]
            g = reference[row, column, 1] - canvas[row, column, 1]
            b = reference[row, column, 2] - canvas[row, column, 2]
            if r * r + g * g + b * b < mine:
                break
        path[count, 0], path[count, 1] = x, y
        count += 1
        if count >= path.shape[0]:
            break
    return count


@kernel
def plan(reference, canvas, field, label, radius, threshold, shortest, longest, bend):
    """Strokes of one layer.

    Parameters
    ----------
    reference, canvas : float32 [H, W, 3]: what is wanted (blurred to the brush) and what is
        there.
    field : float32 [H, W, 2], unit directions (x, y) of strokes; their sign is free.
    label : int8 [H, W], regions that a stroke does not leave.
    radius : Half the width of the brush in pixels.
    threshold : Mean color distance of a cell above which it gets a stroke.
    shortest, longest : Number of steps (of one radius) of a stroke.
    bend : 1 follows the field at once, less keeps straight.

    Returns
    -------
    paths : float32 [S, longest + 1, 2], points (x, y).
    counts : int64 [S], points of each path.
    """
    height, width = label.shape
    step = max(int(radius), 2)
    rows, columns = height // step, width // step
    paths = np.zeros((rows * columns, longest + 1, 2), np.float32)
    counts = np.zeros(rows * columns, np.int64)
    strokes = 0
    for j in range(rows):
        for i in range(columns):
            total, worst, wy, wx = 0.0, -1.0, 0, 0
            for y in range(j * step, (j + 1) * step):
                for x in range(i * step, (i + 1) * step):
                    r = reference[y, x, 0] - canvas[y, x, 0]
                    g = reference[y, x, 1] - canvas[y, x, 1]
                    b = reference[y, x, 2] - canvas[y, x, 2]
                    apart = sqrt(r * r + g * g + b * b)
                    total += apart
                    if apart > worst:
                        worst, wy, wx = apart, y, x
            if total > threshold * step * step:
                counts[strokes] = _walk(paths[strokes], field, label, reference, canvas, wx + 0.5,
                                        wy + 0.5, radius, shortest, longest, bend, radius > 0.0)
                strokes += 1
    return paths[:strokes], counts[:strokes]


@kernel
def trace(starts, field, label, step, longest, bend):
    """Paths from given points ``starts`` [S, 2] along a field, within one region; as `plan`."""
    paths = np.zeros((starts.shape[0], longest + 1, 2), np.float32)
    counts = np.zeros(starts.shape[0], np.int64)
    none = np.zeros((label.shape[0], label.shape[1], 3), np.float32)
    for s in range(starts.shape[0]):
        counts[s] = _walk(paths[s], field, label, none, none, float(starts[s, 0]),
                          float(starts[s, 1]), step, longest, longest, bend, step < 0.0)
    return paths, counts


@kernel
def lay(canvas, relief, tooth, paths, counts, colors, radius, opacity, dry, rough):
    """Lay strokes on the canvas, in order.

    Parameters
    ----------
    canvas : float32 [H, W, 3], changed.
    relief : float32 [H, W], thickness of the paint, changed.
    tooth : float32 [H, W] in [0, 1], height of the ground's grain; a dry brush touches only its
        tops.
    paths, counts : Strokes of `plan` or `trace`.
    colors : float32 [S, 3], the paint of each stroke.
    radius : Half the width of the brush in pixels.
    opacity : Cover of the paint in [0, 1].
    dry : How soon the paint runs out: 0 never, 1 at the end of the stroke.
    rough : Strength of the bristles' texture in [0, 1].
    """
    height, width = relief.shape
    bristles = 2.0 + 0.75 * radius
    for s in range(paths.shape[0]):
        count = counts[s]
        if count < 2:
            continue
        low_x = high_x = paths[s, 0, 0]
        low_y = high_y = paths[s, 0, 1]
        for k in range(1, count):
            low_x, high_x = min(low_x, paths[s, k, 0]), max(high_x, paths[s, k, 0])
            low_y, high_y = min(low_y, paths[s, k, 1]), max(high_y, paths[s, k, 1])
        x0, x1 = max(int(low_x - radius) - 1, 0), min(int(high_x + radius) + 2, width)
        y0, y1 = max(int(low_y - radius) - 1, 0), min(int(high_y + radius) + 2, height)
        near = np.full((y1 - y0, x1 - x0), 1e9)
        along = np.zeros((y1 - y0, x1 - x0))
        across = np.zeros((y1 - y0, x1 - x0))
        gone = 0.0
        for k in range(count - 1):
            ax, ay = np.float64(paths[s, k, 0]), np.float64(paths[s, k, 1])
            ex, ey = paths[s, k + 1, 0] - ax, paths[s, k + 1, 1] - ay
            size = sqrt(ex * ex + ey * ey) + 1e-9
            ex, ey = ex / size, ey / size
            bx0 = max(int(min(ax, ax + ex * size) - radius) - 1, x0)
            bx1 = min(int(max(ax, ax + ex * size) + radius) + 2, x1)
            by0 = max(int(min(ay, ay + ey * size) - radius) - 1, y0)
            by1 = min(int(max(ay, ay + ey * size) + radius) + 2, y1)
            for y in range(by0, by1):
                for x in range(bx0, bx1):
                    px, py = x + 0.5 - ax, y + 0.5 - ay
                    u = px * ex + py * ey
                    v = px * ey - py * ex
                    held = min(max(u, 0.0), size)
                    d = sqrt((u - held) ** 2 + v * v)
                    # Beside a bend two segments are equally near: the first keeps the pixel.
                    if d < near[y - y0, x - x0] - 1e-6:
                        near[y - y0, x - x0] = d
                        along[y - y0, x - x0] = gone + u
                        across[y - y0, x - x0] = v
            gone += size
        for y in range(y0, y1):
            for x in range(x0, x1):
                d = near[y - y0, x - x0] / radius
                if d >= 1.0:
                    continue
                u, v = along[y - y0, x - x0], across[y - y0, x - x0] / radius
                hair = 0.6 * noise(v * bristles, u / (9.0 * radius), 3.1 * s) + 0.4 * noise(
                    v * bristles * 2.3, u / (5.0 * radius), 3.1 * s + 0.5)
                body = min((1.0 - d) * (2.5 + 0.2 * radius) * (1.0 + 0.5 * rough * hair), 1.0)
                left = 1.0 - dry * min(max(u / (gone + 1e-6), 0.0), 1.0) ** 2
                touch = left + 0.45 * rough * hair + dry * (tooth[y, x] - 0.6)
                cover = opacity * body * min(max(2.2 * touch - 0.15, 0.0), 1.0)
                if cover <= 0.003:
                    continue
                shade = 1.0 + 0.11 * rough * hair
                for c in range(3):
                    canvas[y, x, c] += cover * (colors[s, c] * shade - canvas[y, x, c])
                thick = 0.55 + 0.45 * hair * rough + 0.35 * exp(-((d - 0.82) / 0.12) ** 2)
                relief[y, x] += cover * (thick * min(radius, 9.0) * 0.11 - 0.8 * relief[y, x])
