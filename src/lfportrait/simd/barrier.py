"""A place in a kernel where threads wait for each other.

Waking a thread from Python takes a tenth of a millisecond. Threads that run a kernel `together`
`meet` as often as they need to: each counts itself, then waits until all have::

    @lean_kernel
    def work(number, together, bell, values):
        ...                    # each its part
        if not meet(bell, together):
            return             # one of them was interrupted
        ...                    # each sees what all have done

    together(work, 2, values)

Threads wait spinning, and after some microseconds let whoever wants have the core: another process
may have taken one of them meanwhile.
"""

from __future__ import annotations

import sys
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from .decorators import identified, lean
from .threads import helping_threads

_SPINS = 2000
"""Looks at the bell, a few nanoseconds each, before the core is let go."""
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
