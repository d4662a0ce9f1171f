"""The hot loop of the page's coding, in Numba: rows predicted from the neighbours before them."""

from __future__ import annotations

import numpy as np

from ...simd.decorators import kernel


@kernel
def code_rows(filled, values, tolerance, residual, decoded):
    """Code the rows of a lattice.

    Parameters
    ----------
    filled
        bool [Z, Y, X], where rows are; they are numbered in this order, x fastest.
    values
        uint8 [N, C]. The channels after the first are corrected by what the first one's guess
        lacked: colors rise and fall together.
    tolerance
        uint8 [N], the largest error of each row.
    residual
        uint8 [C, N] out: what the guesses lack, modulo 256.
    decoded
        uint8 [N, C] out: the values as they are read back.
    """
    planes, rows, columns = filled.shape
    channels = values.shape[1]
    before = np.full((rows, columns), -1, np.int32)
    here = np.full((rows, columns), -1, np.int32)
    number = 0
    for k in range(planes):
        for j in range(rows):
            for i in range(columns):
                if not filled[k, j, i]:
                    here[j, i] = -1
                    continue
                left = here[j, i - 1] if i > 0 else -1
                above = here[j - 1, i] if j > 0 else -1
                deep = before[j, i]
                step = 2 * np.int32(tolerance[number]) + 1
                correction = 0
                for channel in range(channels):
                    total, count = 0, 0
                    if left >= 0:
                        total += np.int32(decoded[left, channel])
                        count += 1
                    if above >= 0:
                        total += np.int32(decoded[above, channel])
                        count += 1
                    if deep >= 0:
                        total += np.int32(decoded[deep, channel])
                        count += 1
                    guess = (2 * total + count) // (2 * count) if count > 0 else 128
                    guess = min(max(guess + correction, 0), 255)
                    lack = np.int32(values[number, channel]) - guess
                    times = (abs(lack) + step // 2) // step
                    shown = guess + (times * step if lack >= 0 else -times * step)
                    shown = min(max(shown, 0), 255)
                    decoded[number, channel] = shown
                    residual[channel, number] = np.uint8((shown - guess) & 255)
                    if channel == 0:
                        correction = shown - guess
                here[j, i] = number
                number += 1
        before, here = here, before
