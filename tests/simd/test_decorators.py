"""Decorators of kernels: what is compiled, how often, and that it still means the same."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from lfportrait.simd.decorators import woven
from lfportrait.simd.vectors import LANES

_load, _store = LANES.load, LANES.store

MODULE = """
import numpy as np
from lfportrait.simd.decorators import kernel, lean

@lean
def third(x):
    return x / 3

@kernel
def one(values):
    return third(values[0])

@kernel
def two(values):
    return third(values[0]) + third(values[1])
"""

CALL = """
import sys
import numpy as np
from numba.core import event
import helpers

class Heard(event.Listener):
    def on_start(self, event):
        print(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event):
        pass

event.register("numba:compile", Heard())
assert getattr(helpers, sys.argv[1])(np.array([6.0, 9.0])) == float(sys.argv[2])
for result in helpers.third.overloads.values():
    print(bool(result.library.get_pointer_to_function(result.fndesc.llvm_func_name)))
"""


@woven
def _part(values, start, share):
    return _load(values, start) * share


def test_a_woven_function_is_translated_once_and_leaves_no_call():
    @numba.njit
    def mixture(values, first, second, out):
        _store(out, 0, _part(values, first, np.float32(0.25))
               + _part(values, second, np.float32(0.75)))
    values, out = np.arange(32, dtype=np.float32), np.empty(16, np.float32)
    mixture(values, 0, 16, out)
    assert np.array_equal(out, values[:16] / 4 + values[16:] * 3 / 4)
    assert len(_part.signatures) == 1
    assert not [line for line in next(iter(mixture.inspect_llvm().values())).splitlines()
                if "call" in line and "_part" in line]


@pytest.mark.slow  # tests/job/test_pipeline.py finds all kernels again in another process
def test_another_process_puts_a_lean_function_from_the_disk_into_its_callers(tmp_path):
    (tmp_path / "helpers.py").write_text(MODULE)

    def compiled(name, wanted):
        return subprocess.run([sys.executable, "-c", CALL, name, wanted], check=True, text=True,
                              cwd=tmp_path, stdout=subprocess.PIPE, env={
                                  **os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}).stdout.split()
    # It has no machine code of its own.
    assert compiled("one", "2.0") == ["one", "third", "False"]
    assert compiled("two", "5.0")[0] == "two"
    assert compiled("two", "5.0") == compiled("one", "2.0") == []


def test_what_is_asked_for_first_hides_no_other_meaning():
    @numba.njit
    def first(things):
        return things[0]

    @numba.njit
    def set_first(things, value):
        things[0] = value
    numbers = numba.typed.List([4, 5])
    set_first(numbers, 7)
    assert (first("abc"), first((2, 3)), first(numbers)) == ("a", 2, 7)
    row = np.arange(4.0)
    set_first(row, 9)
    assert first(row) == 9 and first(row.reshape(2, 2)).tolist() == [9, 1]
