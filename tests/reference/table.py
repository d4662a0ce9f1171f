"""Eq. 6 by brute force: every pixel of the exemplar is tried for a cell."""

import numpy as np


def best_cost(level, cell, cost_position, cost_level, form, query):
    """Cost of every pixel of the exemplar [H, W] for the cell ``query`` (a, j, i)."""
    height, width = level.shape
    y, x = np.mgrid[:height, :width] // cell
    da, dy, dx = level - query[0], y - query[1], x - query[2]
    if form == "squared":
        cost = cost_position * (dx ** 2 + dy ** 2) + cost_level * da ** 2
    else:
        cost = cost_position * (abs(dx) + abs(dy)) + cost_level * abs(da)
    return cost
