"""Plain NumPy twin of laying brush strokes: every pixel against every segment."""

import itertools

import numpy as np

from .head import noise


def lay(canvas, relief, tooth, paths, counts, colors, radius, opacity, dry, rough):
    """The canvas and relief after the strokes, as new arrays."""
    canvas, relief = canvas.astype(np.float64), relief.astype(np.float64)
    height, width = relief.shape
    y, x = np.mgrid[:height, :width] + 0.5
    for s, count in enumerate(counts):
        if count < 2:
            continue
        points = paths[s, :count].astype(np.float64)
        best = np.full(relief.shape, np.inf)
        along, across = np.zeros(relief.shape), np.zeros(relief.shape)
        gone = 0.0
        for a, b in itertools.pairwise(points):
            size = np.linalg.norm(b - a) + 1e-9
            e = (b - a) / size
            u = (x - a[0]) * e[0] + (y - a[1]) * e[1]
            v = (x - a[0]) * e[1] - (y - a[1]) * e[0]
            d = np.hypot(u - np.clip(u, 0.0, size), v)
            closer = d < best - 1e-6
            best = np.where(closer, d, best)
            along = np.where(closer, gone + u, along)
            across = np.where(closer, v, across)
            gone += size
        d, v = best / radius, across / radius
        bristles = 2.0 + 0.75 * radius
        hair = 0.6 * noise(v * bristles, along / (9.0 * radius), 3.1 * s) + 0.4 * noise(
            v * bristles * 2.3, along / (5.0 * radius), 3.1 * s + 0.5)
        body = np.minimum((1.0 - d) * (2.5 + 0.2 * radius) * (1.0 + 0.5 * rough * hair), 1.0)
        left = 1.0 - dry * np.clip(along / (gone + 1e-6), 0.0, 1.0) ** 2
        touch = left + 0.45 * rough * hair + dry * (tooth - 0.6)
        cover = opacity * body * np.clip(2.2 * touch - 0.15, 0.0, 1.0)
        cover = np.where((d < 1.0) & (cover > 0.003), cover, 0.0)
        shade = 1.0 + 0.11 * rough * hair
        canvas += cover[..., None] * (colors[s] * shade[..., None] - canvas)
        thick = 0.55 + 0.45 * hair * rough + 0.35 * np.exp(-(((d - 0.82) / 0.12) ** 2))
        relief += cover * (thick * min(radius, 9.0) * 0.11 - 0.8 * relief)
    return canvas, relief
