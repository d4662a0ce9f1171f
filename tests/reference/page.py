"""Streams of a page read back row by row: the plain twin of `unpack.js`."""

import numpy as np


def restore(filled, data, channels):
    """Values uint8 [N, C] from what the guesses lack."""
    rows = int(filled.sum())
    lacks = np.frombuffer(data, np.uint8).reshape(channels, rows)
    number = np.full(tuple(n + 1 for n in filled.shape), -1)
    number[1:, 1:, 1:][filled] = np.arange(rows)
    values = np.zeros((rows, channels), np.uint8)
    for row, (z, y, x) in enumerate(np.argwhere(filled) + 1):
        near = [n for n in (number[z, y, x - 1], number[z, y - 1, x], number[z - 1, y, x])
                if n >= 0]
        correction = 0
        for channel in range(channels):
            guess = 128
            if near:
                total = sum(int(values[n, channel]) for n in near)
                guess = (2 * total + len(near)) // (2 * len(near))
            guess = min(max(guess + correction, 0), 255)
            values[row, channel] = (guess + int(lacks[channel, row])) % 256
            if channel == 0:
                correction = int(values[row, 0]) - guess
    return values
