"""Compiled functions that do not count references.

Numba counts an array's users whenever it gets another name, and each count is an atomic operation
on memory that all threads share. In a loop that hands arrays to small functions this took up to two
thirds of the time of one thread, and more of two that copy from the same exemplar. So what a
parallel kernel does with a row or a tile is a `lean` function: its arrays are its caller's, who
keeps them; it makes none of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

__all__ = ["lean"]


def lean(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no arrays, without the counting of references.

    Divisions by zero give infinity or NaN, as in NumPy.
    """
    # Numba's types leave the last option out; without it all of this is right, but slow.
    compiler: Any = numba.njit
    return compiler(cache=True, nogil=True, error_model="numpy", _nrt=False)(function)
