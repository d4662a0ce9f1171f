"""Kernels' namespace of one lane: plain numbers under the names of `lfportrait.lanes.vectors`.

A kernel is a factory over a namespace. With this one it is a twin that is easy to debug, and what
a GPU compiler takes: there a thread is one lane.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import njit

from .cache_keys import identified_all

__all__ = ["SCALAR", "one_lane_namespace"]


def one_lane_namespace(jit: Callable[..., Any]) -> SimpleNamespace:
    """The same names for one lane: plain numbers, as a GPU thread has them.

    Parameters
    ----------
    jit
        Decorator that compiles a function: Numba's for the CPU, a GPU compiler's for device code.
    """
    @jit
    def one_float(value):
        return np.float32(value)

    @jit
    def one_int(value):
        return np.int32(value)

    @jit
    def one_mask(value):
        return bool(value)

    @jit
    def zero():
        return np.int32(0)

    @jit
    def choose(condition, yes, no):
        return yes if condition else no

    @jit
    def floor_one(x):
        return np.float32(math.floor(x))

    @jit
    def least(a, b):
        return a if a < b else b

    @jit
    def greatest(a, b):
        return a if a > b else b

    @jit
    def exp_one(x):
        return np.float32(math.exp(x))

    @jit
    def item(array, index):
        return array[np.uintp(index)]

    @jit
    def item3(array, index):
        # Flat index into an array of three dimensions (the brick table).
        high, wide = np.int32(array.shape[1]), np.int32(array.shape[2])
        row = index // wide
        return array[row // high, row % high, index % wide]

    @jit
    def half(word):
        # Numba has no float16 on the CPU: decode sign, exponent and fraction.
        exponent, fraction = (word >> 10) & 31, word & 1023
        if exponent == 0:
            size = fraction * 2.0 ** -24
        elif exponent == 31:
            size = math.inf if fraction == 0 else math.nan
        else:
            size = (1024 + fraction) * 2.0 ** (exponent - 25.0)
        return np.float32(-size if word & 0x8000 else size)

    @jit
    def half_pair(array, index):
        return half(array[np.uintp(index)]), half(array[np.uintp(index) + np.uintp(1)])

    @jit
    def mask_bits(mask):
        return np.uint32(1) if mask else np.uint32(0)

    @jit
    def first(word):
        return np.uint32(0)

    @jit
    def self_lane(value, index):
        return value

    return SimpleNamespace(
        width=1, jit=jit, floats=one_float, ints=one_int, masks=one_mask, iota=zero, where=choose,
        floor=floor_one, minimum=least, maximum=greatest, exp=exp_one, gather=item, gather3=item3,
        gather_pair=half_pair, half=half,
        bits=mask_bits, lowest=first, lane=self_lane)


SCALAR = one_lane_namespace(njit)
identified_all("lanes", SCALAR.width, SCALAR)
