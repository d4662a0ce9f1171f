"""Moving least squares with similarities, written as the minimisation that defines it."""

import numpy as np


def mls_similarity(points, sources, targets, weights=None):
    """For each point: weighted least squares for (a, b, tx, ty), solved by brute force."""
    weights = np.ones(len(sources)) if weights is None else weights
    out = []
    for v in points:
        distance = ((sources - v) ** 2).sum(axis=1)
        if distance.min() < 1e-12:
            out.append(targets[distance.argmin()])
            continue
        root = np.sqrt(weights / distance)
        rows, right = [], []
        for (x, y), (u, w), r in zip(sources, targets, root):
            rows += [r * np.array([x, -y, 1, 0]), r * np.array([y, x, 0, 1])]
            right += [r * u, r * w]
        a, b, tx, ty = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]
        out.append([a * v[0] - b * v[1] + tx, b * v[0] + a * v[1] + ty])
    return np.array(out)
