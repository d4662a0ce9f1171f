"""Threads that wait for each other in a kernel."""

import numba
import numpy as np
import pytest

from lfportrait.simd import threads
from lfportrait.simd.decorators import lean_kernel
from lfportrait.simd.threads import meet, together


@lean_kernel
def _pass_on(number, threads, bell, values, seen):
    """Each writes its place of every line from all places of the line before."""
    for line in range(1, len(values)):
        for place in range(number, values.shape[1], threads):
            total = 0
            for other in range(values.shape[1]):
                total += values[line - 1, other]
            values[line, place] = total % 1000 + place
        if not meet(bell, threads):
            return
    seen[number] = len(values)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_no_thread_goes_on_before_all_have_come(threads):
    had = numba.get_num_threads()
    if threads > numba.config.NUMBA_NUM_THREADS:
        pytest.skip(f"numba has {numba.config.NUMBA_NUM_THREADS} threads here")
    values, seen = np.zeros((3000, 6), np.int64), np.zeros(3, np.int64)
    values[0] = np.arange(6)
    wanted = values[0].copy()
    numba.set_num_threads(threads)
    try:
        together(_pass_on, 3, values, seen)
    finally:
        numba.set_num_threads(had)
    for line in values[1:]:
        wanted = wanted.sum() % 1000 + np.arange(6)
        assert np.array_equal(line, wanted)
    assert list(seen) == [3000] * threads + [0] * (3 - threads)


def test_those_who_wait_go_home_if_one_is_interrupted(monkeypatch):
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread waits for nobody")
    seen, values = np.zeros(2, np.int64), np.zeros((5, 2), np.int64)

    def interrupted(number, threads, bell, values, seen):
        if number == 0:
            while not values[1, 1]:  # the other one has begun
                pass
            raise KeyboardInterrupt
        _pass_on(number, threads, bell, values, seen)

    values[0] = 1
    monkeypatch.setattr(threads, "_SPINS", 10)
    with pytest.raises(KeyboardInterrupt):
        together(interrupted, 2, values, seen)
    assert not seen.any()
