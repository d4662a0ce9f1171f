"""Labels, weights and votes of the transfer, pixel by pixel, as their docstrings word them."""

from collections import Counter

import numpy as np


def enlarged(small, factor, shape):
    """Block means [h, w] bilinear between the blocks' middles, [H, W]."""
    def places(count, length):
        at = np.clip((np.arange(length) + 0.5) / factor - 0.5, 0, count - 1)
        block = np.minimum(at.astype(int), max(count - 2, 0))
        return block, np.minimum(block + 1, count - 1), at - block

    j, below, fy = places(small.shape[0], shape[0])
    i, right, fx = places(small.shape[1], shape[1])
    rows = small[j] + fy[:, None] * (small[below] - small[j])
    return rows[:, i] + fx * (rows[:, right] - rows[:, i])


def labels(person, hair, planes, factor, hair_is_skin, body_is_ground):
    """Soft labels, float [H, W, 8] in 0 to 255."""
    rest, out = np.ones(person.shape), []
    for plane in planes[:4]:
        soft = enlarged(plane, factor, person.shape)
        out.append(soft * rest)
        rest = rest * (1 - soft)
    body = enlarged(planes[4], factor, person.shape)
    inside = person * rest
    crown = 0 * hair if hair_is_skin else hair
    skin = inside * (1 - crown)
    low = 0 * skin if body_is_ground else skin * body
    ground = rest - inside + (skin * body if body_is_ground else 0)
    return 255 * np.stack([*out, skin * (1 - body), inside * crown, low, ground], axis=-1)


def weights(person, label, soft, face, lines, factor, place, outline, look, hair, body, skin,
            hold):
    """Weights of place and appearance, [H, W, 2]."""
    edge = enlarged(soft, factor, person.shape)
    away = 1 - enlarged(face, factor, person.shape)
    held, share = (1 - (1 - hair[n]) * label[..., 5] / 255 - (1 - body[n]) * label[..., 6] / 255
                   for n in range(2))
    share = share - (1 - skin) * away * label[..., 4] / 255
    drawn = enlarged(lines, factor, person.shape)
    share = share * (1 - drawn)
    near = (place[0] + (place[1] - place[0]) * person) * held
    near = near + 4 * outline * np.maximum(
        edge * (1 - edge), label[..., 4] * (label[..., 6] / 65025 + label[..., 7] / 65025))
    near = near * (1 + hold * drawn)
    return np.stack([near, (look[0] + (look[1] - look[0]) * person) * share], axis=-1)


def window(y, x, radius, shape):
    return [(v, u) for v in range(max(y - radius, 0), min(y + radius + 1, shape[0]))
            for u in range(max(x - radius, 0), min(x + radius + 1, shape[1]))]


def elect(shift, radius):
    """The most frequent shift [H, W, 2] of each window; NaN has no vote and gets none."""
    out = shift.copy()
    for y, x in np.ndindex(shift.shape[:2]):
        votes = Counter(tuple(shift[v, u]) for v, u in window(y, x, radius, shift.shape)
                        if np.isfinite(shift[v, u, 0]))
        if np.isfinite(shift[y, x, 0]):
            first, most = max(votes.items(), key=lambda item: item[1])
            if most > votes[tuple(shift[y, x])]:
                out[y, x] = first
    return out


def sample(picture, x, y, exact):
    height, width = picture.shape[:2]
    if exact:
        return picture[int(np.clip(np.floor(y), 0, height - 1)),
                       int(np.clip(np.floor(x), 0, width - 1))]
    x, y = np.clip(x - 0.5, 0, width - 1), np.clip(y - 0.5, 0, height - 1)
    i, j = min(int(x), width - 2), min(int(y), height - 2)
    top = picture[j, i] + (x - i) * (picture[j, i + 1] - picture[j, i])
    low = picture[j + 1, i] + (x - i) * (picture[j + 1, i + 1] - picture[j + 1, i])
    return top + (y - j) * (low - top)


def vote(picture, anchor, shift, radius, exact):
    """Mean of the colors [H, W, 3] that the window votes for; 0 without a shift."""
    out = np.zeros((*shift.shape[:2], 3))
    for y, x in np.ndindex(shift.shape[:2]):
        if np.isfinite(shift[y, x, 0]):
            out[y, x] = np.mean([sample(picture, *(anchor[y, x] + shift[v, u]), exact)
                                 for v, u in window(y, x, radius, shift.shape)
                                 if np.isfinite(shift[v, u, 0])], axis=0)
    return out
