"""Guided patch synthesis in plain loops: patch error, one pass of the search, votes."""

import numpy as np


def error(target, y, x, source, v, u, radius, margin):
    """Sum of squared differences; ``target`` has a margin all around, both have channels."""
    one = target[y + margin - radius:y + margin + radius + 1,
                 x + margin - radius:x + margin + radius + 1].astype(np.float64)
    two = source[v - radius:v + radius + 1, u - radius:u + radius + 1].astype(np.float64)
    return ((one - two) ** 2).sum()


def search(target, source, guided, field, radius, margin, forward):
    """Propagation and the guides' place, without crowds and random steps; new field [H, W]."""
    field = field.copy()
    height, width = field.shape
    rows, across = source.shape[:2]
    step = 1 if forward else -1
    for y in range(height)[::step]:
        for x in range(width)[::step]:
            own = divmod(int(field[y, x]), across)
            best = error(target, y, x, source, *own, radius, margin)
            candidates = []
            if 0 <= x - step < width:
                v, u = divmod(int(field[y, x - step]), across)
                candidates.append((v, u + step))
            if 0 <= y - step < height:
                v, u = divmod(int(field[y - step, x]), across)
                candidates.append((v + step, u))
            candidates.append(divmod(int(guided[y, x]), across))
            for v, u in candidates:
                v, u = (min(max(v, margin), rows - 1 - margin),
                        min(max(u, margin), across - 1 - margin))
                found = error(target, y, x, source, v, u, radius, margin)
                if found < best:
                    best, own = found, (v, u)
            field[y, x] = own[0] * across + own[1]
    return field


def vote(field, errors, picture, radius, softness):
    """Weighted mean of the votes, [H, W, 3]."""
    height, width = field.shape
    total, weights = np.zeros((height, width, 3)), np.zeros((height, width, 1))
    for y in range(height):
        for x in range(width):
            v, u = divmod(int(field[y, x]), picture.shape[1])
            for j in range(-radius, radius + 1):
                for i in range(-radius, radius + 1):
                    if 0 <= y + j < height and 0 <= x + i < width:
                        weight = 1 / (softness + errors[y, x])
                        total[y + j, x + i] += weight * picture[v + j, u + i]
                        weights[y + j, x + i] += weight
    return total / weights
