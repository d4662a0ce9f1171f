"""Probe this machine: random memory lines and multiply-adds per second, for lower bounds."""

from __future__ import annotations

import numpy as np

from lfportrait.simd.decorators import lean_kernel
from lfportrait.simd.threads import shared
from lfportrait.simd.vectors import LANES

_floats, _load, _store = LANES.floats, LANES.load, LANES.store


@shared("out")
@lean_kernel
def random_lines(since, until, table, count, out):
    """Read ``count`` random lines of 64 bytes by each of ``len(out)`` workers.

    ``table`` float32 [16 * K], K a power of two; ``out`` float32 [workers, 16], the sums of what
    was read.
    """
    mask = np.uint64(len(table) // 16 - 1)
    for worker in range(since, until):
        # The places come from a generator, not from what was read: reads may overlap.
        state = np.uint64(worker) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(1)
        sums = _floats(np.float32(0.0))
        for _ in range(count):
            state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
            sums = sums + _load(table, np.uintp(((state >> np.uint64(33)) & mask) << np.uint64(4)))
        _store(out[worker], 0, sums)


@shared("out")
@lean_kernel(fastmath=True)
def multiply_adds(since, until, count, factor, out):
    """``count`` times eight multiply-adds of 16 lanes by each of ``len(out)`` workers.

    ``factor`` float32, what the values are multiplied with; ``out`` float32 [workers, 16], the
    sums.
    """
    for worker in range(since, until):
        scale, more = _floats(factor), _floats(np.float32(1e-3))
        a = _floats(np.float32(worker + 1))
        b, c, d = a + more, a + more + more, a - more
        e, f, g, h = a + a, b + b, c + c, d + d
        for _ in range(count):
            a, b, c, d = a * scale + more, b * scale + more, c * scale + more, d * scale + more
            e, f, g, h = e * scale + more, f * scale + more, g * scale + more, h * scale + more
        _store(out[worker], 0, a + b + c + d + e + f + g + h)
