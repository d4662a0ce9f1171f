"""Lines of a kernel shared out to threads: each once, whatever the threads do."""

import threading

import numba
import numpy as np
import pytest

from lfportrait.lanes.decorators import kernel, lean, lean_kernel
from lfportrait.lanes.threads import share_out, shared


@lean
def _half(value):
    return value / 2


@shared("out", per=3)
@lean_kernel
def _triples(since, until, values, out):
    for row in range(3 * since, min(3 * until, len(out))):
        out[row] += _half(values[row])


@shared("count")
@kernel
def _numbers(since, until, count, out):
    for row in range(since, until):
        out[row] += row


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("count", [0, 1, 2, 7, 1000])
def test_each_line_is_done_once(count, threads):
    before = numba.get_num_threads()
    out = np.zeros(count)
    try:
        numba.set_num_threads(min(threads, before))
        _triples(np.arange(count), out)
        assert np.array_equal(out, np.arange(count) / 2)
        _numbers(count, out)
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(out, 1.5 * np.arange(count))


def test_callers_on_several_threads_do_not_wait_for_each_other():
    outs = [np.zeros(5000) for _ in range(6)]
    callers = [threading.Thread(target=_numbers, args=(5000, out)) for out in outs]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert all(np.array_equal(out, np.arange(5000)) for out in outs)


def test_what_a_piece_raises_reaches_the_caller():
    def fail(first, last):
        raise ValueError(first)

    with pytest.raises(ValueError):
        share_out(fail, 100)


def test_python_is_told_that_it_must_not_call_a_lean_function():
    with pytest.raises(TypeError, match="by kernels only"):
        _half(2.0)
    _triples(np.ones(3, np.int64), np.zeros(3))  # which compiles it
    with pytest.raises(TypeError, match="by kernels only"):
        _half(np.int64(2))
