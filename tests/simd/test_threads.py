"""Lines of a kernel shared out to threads: each once, whatever the threads do."""

import threading

import numba
import numpy as np
import pytest

from lfportrait.simd.decorators import kernel, lean, lean_kernel
from lfportrait.simd.threads import share_out, shared, side_by_side


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


@pytest.mark.parametrize("most", [1, 2, 64])
@pytest.mark.parametrize("count", [0, 1, 9])
def test_items_side_by_side_keep_their_order_and_the_callers_threads(most, count):
    before = numba.get_num_threads()
    under_way, seen = [], []

    def work(item):
        under_way.append(item)
        seen.append(len(under_way))
        out = np.zeros(50)
        _numbers(50, out)
        under_way.remove(item)
        return item, numba.get_num_threads(), out

    found = side_by_side(work, range(count), most)
    assert [item for item, _, _ in found] == list(range(count))
    assert all(np.array_equal(out, np.arange(50)) for _, _, out in found)
    assert numba.get_num_threads() == before
    assert max(seen, default=0) <= min(most, before)
    if min(most, before, count) > 1:
        assert {threads for _, threads, _ in found} == {1}


def test_what_an_item_raises_is_raised():
    def work(item):
        if item == 3:
            raise KeyError(item)

    with pytest.raises(KeyError):
        side_by_side(work, range(6))
