"""StyleBlit as its paper words it, pixel by pixel: no seed tables, no parallel loops."""

import numpy as np


def synthesise(position, appearance, anchor, weights, style_appearance, own_shift, own_error,
               seeds, levels, threshold, slack):
    """Shift and level of every pixel.

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
                qy, qx = near[int(np.argmin(distance))][1]
                place = anchor[y, x] + own_shift[qy, qx]
                if not (0 <= place[0] < style_width and 0 <= place[1] < style_height):
                    continue
                error = (weights[y, x, 0] * np.abs(position[y, x] - place).sum()
                         + weights[y, x, 1] * abs(appearance[y, x] - style_appearance[
                             int(place[1]), int(place[0])]))
                if error < max(threshold, own_error[y, x] + slack):
                    shift[y, x], level_map[y, x] = own_shift[qy, qx], level
                    break
    return shift, level_map
