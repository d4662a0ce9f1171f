"""Sixteen numbers at once (SIMD) for kernels in Numba, and how such kernels are compiled.

A kernel is a factory over a namespace of operations, which `vectors` gives it. `processor` defines
lanes for Numba and says which instructions are used; `interleaved` adds loads, stores and orders
that pictures and short rows need; `decorators` compile kernels and keep what is compiled, `threads`
share out a kernel's lines, `host` is about the machine.

No kernel here uses Numba's own threads, but one that a user brings may, and Numba loads them when
it is asked how many there are: OpenMP's where there is one, because the fallback may not be entered
from two Python threads at once (a viewer does that).
"""

import os
import warnings
from typing import Any

import numba
from numba.core.caching import FunctionCache

from ..files import temporary_home
from ..measure import usable_cores
from .processor import limit_vectors

__all__ = ["keep_kernels", "limit_threads"]

_settings: Any = numba.config

setattr(numba.config, "THREADING_LAYER_PRIORITY", ["omp", "tbb", "workqueue"])  # noqa: B010


def _any_kernel() -> None:
    """Stands for all kernels: their code is kept where this one's would be."""


def keep_kernels() -> None:
    """Choose a folder for compiled kernels: beside the sources, in the home, or temporary.

    Installed read-only, and with a user without a home, as in most containers, Numba finds no place
    and gives up; then they go to the temporary folder, and a line says so.
    """
    try:
        FunctionCache(_any_kernel)
    except RuntimeError:
        folder = temporary_home() / "kernels"
        _settings.CACHE_DIR = str(folder)
        warnings.warn(f"no cache folder for compiled kernels is writable, so they go to {folder}; "
                      "set NUMBA_CACHE_DIR=FOLDER to keep them", stacklevel=1)


def limit_threads() -> None:
    """As many threads as usable cores: Numba does not know how little time a container gets."""
    if "NUMBA_NUM_THREADS" not in os.environ:
        _settings.NUMBA_NUM_THREADS = min(_settings.NUMBA_NUM_THREADS, usable_cores())


limit_vectors()
limit_threads()
keep_kernels()
