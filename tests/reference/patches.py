"""Guided patch synthesis in plain loops: patch error, one pass of the search, uses, votes."""

from dataclasses import dataclass

import numpy as np

from lfportrait.example.kernels.patches import ACTIVE, BAND, CELL, MARGIN, OUTSIDE

WORD = (1 << 64) - 1


@dataclass
class Problem:
    """Two pictures [H, W, C], their first guide in channel 3, and what each target pixel wants."""

    target: np.ndarray
    """With a margin all around."""
    source: np.ndarray
    state: np.ndarray
    trust: np.ndarray
    wanted: np.ndarray
    weight: np.ndarray
    limit: float

    def error(self, y, x, v, u, radius):
        """Weighted sum of squared differences of two patches, and what being astray costs."""
        one = self.target[y + MARGIN - radius:y + MARGIN + radius + 1,
                          x + MARGIN - radius:x + MARGIN + radius + 1].astype(np.float64)
        two = self.source[v - radius:v + radius + 1, u - radius:u + radius + 1].astype(np.float64)
        scales = np.ones(one.shape[2])
        scales[3:5] = self.trust[y, x]
        away = ((np.array([u, v]) + 0.5 - self.wanted[y, x]) ** 2).sum()
        astray = (2 * radius + 1) ** 2 * self.weight[y, x] * min(away, self.limit)
        return ((one - two) ** 2 * scales).sum() + astray

    def errors(self, field, radius):
        """Of all pixels, float64 [H, W]; 0 outside."""
        out = np.zeros(field.shape)
        for y, x in zip(*np.nonzero(self.state != OUTSIDE)):
            out[y, x] = self.error(y, x, *divmod(int(field[y, x]), self.source.shape[1]), radius)
        return out


def _noise(state):
    state ^= state << 13 & WORD
    state ^= state >> 7
    return state ^ (state << 17 & WORD)


def search(problem, uses, penalty, guided, before, radius, reach, forward, seed):
    """New field and its errors [H, W], pixel by pixel in the order of the scan."""
    rows, across = problem.source.shape[:2]
    height, width = before.shape
    field, errors = before.copy(), problem.errors(before, radius)
    step = 1 if forward else -1
    for top in range(0, height, BAND):
        crowd = uses * penalty
        band = range(top, min(top + BAND, height))
        for y, x in [(y, x) for y in band[::step] for x in range(width)[::step]]:
            if problem.state[y, x] != ACTIVE:
                continue
            noise = _noise(_noise((y * width + x + 1) * 0x9E3779B97F4A7C15 & WORD ^ seed))
            v, u = divmod(int(field[y, x]), across)
            best = errors[y, x] + crowd[v // CELL, u // CELL]
            near = []
            if 0 <= x - step < width:
                q, p = divmod(int(field[y, x - step]), across)
                near.append((q, p + step))
            if 0 <= y - step < height:
                seen = field if y - step in band else before
                q, p = divmod(int(seen[y - step, x]), across)
                near.append((q + step, p))
            near.append(divmod(int(guided[y, x]), across))
            now = reach
            while near or now >= 1:
                if near:
                    q, p = near.pop(0)
                else:
                    noise = _noise(noise)
                    p = u + (noise >> 40) % (2 * now + 1) - now
                    q = v + (noise >> 16 & 0xFFFFFF) % (2 * now + 1) - now
                    now //= 2
                q = min(max(q, MARGIN), rows - 1 - MARGIN)
                p = min(max(p, MARGIN), across - 1 - MARGIN)
                old, new = (v // CELL, u // CELL), (q // CELL, p // CELL)
                fine = crowd[new] + (penalty[new] if old != new else 0)
                found = problem.error(y, x, q, p, radius)
                if (q, p) != (v, u) and found + fine < best:
                    best, errors[y, x] = found + fine, found
                    crowd[old] -= penalty[old]
                    crowd[new] += penalty[new]
                    v, u = q, p
            field[y, x] = v * across + u
    return field, errors


def uses(field, state, shape):
    """Active pixels' patches from each cell of an exemplar of a shape."""
    out = np.zeros((-(-shape[0] // CELL), -(-shape[1] // CELL)))
    for place in field[state == ACTIVE]:
        out[place // shape[1] // CELL, place % shape[1] // CELL] += 1
    return out


def vote(field, errors, state, picture, radius, softness, out):
    """``out`` [H, W, 3] with active pixels changed to the weighted mean of their votes."""
    height, width = field.shape
    total, weights = np.zeros((height, width, 3)), np.zeros((height, width, 1))
    for y, x in zip(*np.nonzero(state != OUTSIDE)):
        v, u = divmod(int(field[y, x]), picture.shape[1])
        for j in range(-radius, radius + 1):
            for i in range(-radius, radius + 1):
                if (0 <= y + j < height and 0 <= x + i < width
                        and 0 <= v + j < len(picture) and 0 <= u + i < picture.shape[1]):
                    weight = 1 / (softness + errors[y, x])
                    total[y + j, x + i] += weight * picture[v + j, u + i]
                    weights[y + j, x + i] += weight
    return np.where((state == ACTIVE)[..., None], total / np.maximum(weights, 1e-300), out)
