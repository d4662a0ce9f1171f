"""Distribute the lines of kernels to threads.

A loop whose turns do not depend on each other is a kernel over some of its turns, from ``first`` to
``last``::

    @shared("image")
    @lean_kernel
    def invert(first, last, image):
        for y in range(first, last):
            for x in range(image.shape[1]):
                image[y, x] = 1 - image[y, x]

    invert(image)   # all rows, on all threads

Numba has threads of its own (`parallel=True`). It compiles such a loop twice for them, as part of
its function and as a function of its own, after a search for whatever else could be done at once:
more than half of the time to compile all kernels. Its threads also wait for each other spinning,
which costs milliseconds a kernel where another process has the second core.

Here the caller and a pool of Python threads take pieces until none is left; kernels do without
Python's lock. A helper that is busy elsewhere is not waited for. How many threads there are is
Numba's setting (`NUMBA_NUM_THREADS`, `numba.set_num_threads`).
"""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import numba

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_PIECES = 4
"""Pieces a thread, so that the threads end together where lines take unlike times."""


@functools.cache
def helping_threads() -> ThreadPoolExecutor:
    """The threads besides the caller's."""
    settings: Any = numba.config
    return ThreadPoolExecutor(max(settings.NUMBA_NUM_THREADS - 1, 1), "kernels")


if hasattr(os, "register_at_fork"):
    # A forked process has none of its parent's threads.
    os.register_at_fork(after_in_child=helping_threads.cache_clear)


def share_out(kernel: Callable[..., object], count: int, *arguments: Any) -> None:
    """Call ``kernel(first, last, *arguments)`` on pieces of ``range(count)``, on all threads."""
    threads = min(numba.get_num_threads(), count)
    if threads < 2:
        kernel(0, count, *arguments)
        return
    pieces = min(_PIECES * threads, count)
    left = [(n * count // pieces, (n + 1) * count // pieces) for n in range(pieces - 1, -1, -1)]

    def work() -> None:
        while left:
            try:
                first, last = left.pop()
            except IndexError:  # another thread took it meanwhile
                return
            kernel(first, last, *arguments)

    helpers = [helping_threads().submit(work) for _ in range(threads - 1)]
    try:
        work()
    finally:
        left.clear()
        for helper in helpers:
            if not helper.cancel():
                helper.result()


def side_by_side(work: Callable[[_Item], _Result], items: Sequence[_Item],
                 most: int = 64) -> list[_Result]:
    """What ``work`` gives for each item, in the items' order; so many at a time as threads.

    Kernels that it calls keep to the thread of their item: many small pictures take less time in
    this way than one after the other, each on all threads. ``most`` bounds how many are in memory
    at a time.
    """
    threads = min(numba.get_num_threads(), len(items), most)
    if threads < 2:
        return [work(item) for item in items]
    with ThreadPoolExecutor(threads, "items", numba.set_num_threads, (1,)) as pool:
        return list(pool.map(work, items))


def with_kernel(call: Callable[..., None], kernel: Any) -> Callable[..., None]:
    """A function that shares a kernel out, and the kernel as its attribute ``kernel``."""
    setattr(call, "kernel", kernel)  # noqa: B010
    return call


def shared(over: str, per: int = 1) -> Callable[[Any], Callable[..., None]]:
    """Decorate a kernel ``(first, last, ...)`` to be called without these two, on all threads.

    Parameters
    ----------
    over : The parameter that says how many lines there are: a number, or an array with so many
        rows.
    per : Rows of that array in a line.

    Returns
    -------
    decorate : What it gives has the compiled function as ``kernel``.
    """
    def decorate(kernel: Any) -> Callable[..., None]:
        place = list(inspect.signature(kernel.py_func).parameters).index(over) - 2

        @functools.wraps(kernel.py_func)
        def call(*arguments: Any) -> None:
            lines = arguments[place]
            count = lines if isinstance(lines, int) else len(lines)
            share_out(kernel, -(-count // per), *arguments)
        return with_kernel(call, kernel)
    return decorate
