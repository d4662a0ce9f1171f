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

Numba's own parallel loops (`parallel=True`) take twice as long to compile, and their threads wait
spinning, which costs milliseconds a kernel where another process has the second core. Here the
caller and a pool of Python threads take pieces until none is left; kernels do without Python's
lock. A helper that is busy elsewhere is not waited for. How many threads there are is Numba's
setting (`NUMBA_NUM_THREADS`, `numba.set_num_threads`).

Waking a thread from Python takes a tenth of a millisecond. So threads can also wait for each other
in a kernel: those that run it `together` `meet` as often as they need to::

    @lean_kernel
    def work(number, together, bell, values):
        ...                    # each its part
        if not meet(bell, together):
            return             # one of them was interrupted
        ...                    # each sees what all have done

    together(work, 2, values)

Threads wait spinning, and after some microseconds let whoever wants have the core.
"""

import functools
import inspect
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from .decorators import identified, lean

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_PIECES = 4  # Pieces a thread, so that the threads end together where lines take unlike times.


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

    What it gives has the compiled function as ``kernel``.

    Parameters
    ----------
    over : The parameter that says how many lines there are: a number, or an array with so many
        rows.
    per : Rows of that array in a line.
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


_SPINS = 2000  # Looks at the bell, a few nanoseconds each, before the core is let go.
_ARRIVED, _OVER = 0, 16
"""Places in the bell, on cache lines of their own: how often a thread has arrived; whether to go
home."""
_YIELD = "SwitchToThread" if sys.platform == "win32" else "sched_yield"
_let_go = types.ExternalFunction(_YIELD, types.int32())


def _place(context, builder, sig, args):
    """Address of array[index]."""
    base = context.make_array(sig.args[0])(context, builder, args[0]).data
    return builder.gep(base, [context.cast(builder, args[1], sig.args[1], types.uintp)])


@identified("barrier", "count")
@intrinsic
def _count(typing, array, index):
    """Add one to array[index], at once for all threads; what it was."""
    def code(context, builder, sig, args):
        one = context.get_constant(types.int64, 1)
        return builder.atomic_rmw("add", _place(context, builder, sig, args), one, "seq_cst")
    return types.int64(array, index), code


@identified("barrier", "look")
@intrinsic
def _look(typing, array, index):
    """array[index] as it is now."""
    def code(context, builder, sig, args):
        return builder.load_atomic(_place(context, builder, sig, args), "acquire", 8)
    return types.int64(array, index), code


@lean
def meet(bell, together):
    """Wait for all of ``together`` threads; False if one of them will not come."""
    goal = (_count(bell, np.uintp(_ARRIVED)) // together + 1) * together
    spins = 0
    while _look(bell, np.uintp(_ARRIVED)) < goal:
        if _look(bell, np.uintp(_OVER)) != 0:
            return False
        spins += 1
        if spins > _SPINS:
            _let_go()
    return True


def together(kernel: Any, most: int, *arguments: Any) -> None:
    """Call ``kernel(number, threads, bell, *arguments)`` on all threads, ``most`` at most.

    They may `meet`.
    """
    threads = max(1, min(numba.get_num_threads(), most))
    bell = np.zeros(2 * _OVER, np.int64)
    others = [helping_threads().submit(kernel, number, threads, bell, *arguments)
              for number in range(1, threads)]
    done = False
    try:
        kernel(0, threads, bell, *arguments)
        done = True
    finally:
        if not done:
            bell[_OVER] = 1
        for other in others:
            if done or not other.cancel():
                other.result()
