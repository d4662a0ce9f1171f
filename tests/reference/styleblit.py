"""StyleBlit as its paper words it, pixel by pixel: no seed tables, no parallel loops."""

import numpy as np


def correction(position, anchor, y, x, point):
    """Change of position minus anchor from the middle of a pixel to a seed beside it."""
    height, width = position.shape[:2]
    right, below = (y, min(x + 1, width - 1)), (min(y + 1, height - 1), x)
    turn = np.stack([anchor[right] - anchor[y, x], anchor[below] - anchor[y, x]], axis=1)
    if abs(np.linalg.det(turn)) < 0.05:
        return np.zeros(2, np.float32)
    off = point - anchor[y, x]
    steps = np.linalg.solve(turn, off)
    slopes = np.stack([position[right] - position[y, x], position[below] - position[y, x]], axis=1)
    change = slopes @ steps - off
    far = (np.abs(steps) > 2).any() or (np.abs(change) > 2).any()
    return np.zeros(2, np.float32) if far else change.astype(np.float32)


def synthesise(position, appearance, anchor, weights, style_appearance, own_shift, own_error,
               seeds, levels, threshold, slack, free=False):
    """Shift and level of every pixel; ``free``: shifts are taken at the seed itself.

    ``seeds`` maps a level to a list of (point [2], pixel (y, x)) of all its seeds.
    """
    height, width = appearance.shape
    style_height, style_width = style_appearance.shape
    shift, level_map = own_shift.copy(), np.zeros((height, width), np.uint8)
    for y in range(height):
        for x in range(width):
            for level in range(levels, 0, -1):
                side = 2 ** level
                here = np.floor(anchor[y, x] / np.float32(side))
                near = [(point, pixel) for point, pixel in seeds[level]
                        if (abs(np.floor(point / np.float32(side)) - here) <= 1).all()]
                if not near:
                    continue
                distance = [((anchor[y, x] - point) ** 2).sum() for point, _ in near]
                point, (qy, qx) = near[int(np.argmin(distance))]
                chunk = own_shift[qy, qx]
                if free:
                    chunk = chunk + correction(position, anchor, qy, qx, point)
                place = anchor[y, x] + chunk
                if not (0 <= place[0] < style_width and 0 <= place[1] < style_height):
                    continue
                error = (weights[y, x, 0] * np.abs(position[y, x] - place).sum()
                         + weights[y, x, 1] * abs(appearance[y, x] - style_appearance[
                             int(place[1]), int(place[0])]))
                if error < max(threshold, own_error[y, x] + slack):
                    shift[y, x], level_map[y, x] = chunk, level
                    break
    return shift, level_map
