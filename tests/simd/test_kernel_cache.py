"""The next process finds compiled kernels again: compiling takes seconds, loading does not."""

import contextlib
import os
import pickle
import shutil
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from numba.core.caching import IndexDataCacheFile

import lfportrait
from lfportrait.files import lock
from lfportrait.simd import decorators
from lfportrait.simd.decorators import kernel

# The smallest factory whose kernel calls a function that the factory made, too: a process that
# compiles takes a few seconds here, and twenty for the field's kernels.
SCRIPT = """
import sys
import numpy as np
from lfportrait.example.kernels.patches import ACTIVE, CHANNELS, MARGIN, patch_errors

random = np.random.default_rng(0)
shape = 6, 7
target, source = (random.integers(0, 99, rows * across * CHANNELS + 16).astype(np.float16).view(
    np.uint16) for rows, across in ((6 + 2 * MARGIN, 7 + 2 * MARGIN), (20, 21)))
places = random.integers(9, 12, (2, *shape))
field, error = (21 * places[0] + places[1]).astype(np.int32), np.zeros(shape, np.float32)
state, trust = np.full(shape, ACTIVE, np.uint8), np.ones((*shape, 2), np.float32)
wanted, weight = np.zeros((*shape, 2), np.float32), np.zeros(shape, np.float32)
for radius in map(int, sys.argv[1:]):
    patch_errors(radius)(target, source, 21, state, trust, wanted, weight, np.float32(9), field,
                         error)
    print(radius, error.astype(float).sum())
    stats = patch_errors(radius).kernel.stats
    print(sum(stats.cache_hits.values()), sum(stats.cache_misses.values()), file=sys.stderr)
"""

KEYS = """
import lfportrait
from lfportrait.example.kernels.patches import patch_errors, search_pass
from lfportrait.lightfield.kernels.panel import encode_kernel
from lfportrait.field.kernels.render import render_kernel
from lfportrait.field.kernels.train import train_kernel

print(lfportrait.__file__)
for kernel in (train_kernel(32).kernel, encode_kernel(32, 9).kernel, render_kernel(16).kernel,
               patch_errors(1).kernel, search_pass(2).kernel):
    print(kernel.py_func.__name__, kernel._cache._index_key(None, kernel.targetctx.codegen()))
"""


@kernel
def _half(value):
    return value / 2


def run(script, *arguments, **environment):
    return subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True,
                          text=True, check=True, cwd=Path(__file__).parents[2],
                          env={**os.environ, **environment})


@pytest.mark.slow  # tests/job/test_pipeline.py finds all kernels again in another process
def test_products_of_one_factory_are_found_again_and_work_together(tmp_path):
    # Each process numbers its functions anew: their symbols must differ by more than the number.
    one, two = (run(SCRIPT, radius, NUMBA_CACHE_DIR=str(tmp_path)) for radius in ("1", "2"))
    assert (one.stderr.split(), two.stderr.split()) == (["0", "1"], ["0", "1"])
    assert one.stdout.split()[1] != two.stdout.split()[1]
    both = run(SCRIPT, "1", "2", NUMBA_CACHE_DIR=str(tmp_path))
    assert both.stderr.split() == ["1", "0", "1", "0"]  # the next process compiles nothing
    assert both.stdout == one.stdout + two.stdout


def test_what_two_processes_compile_at_a_time_is_found_under_its_own_types(tmp_path, monkeypatch):
    """Both read the index before either has written it, where nothing holds one of them up."""
    both, read = threading.Barrier(2), IndexDataCacheFile._load_index

    def slow(self):
        found = read(self)
        with contextlib.suppress(threading.BrokenBarrierError):
            both.wait(0.2)
        return found

    monkeypatch.setattr(IndexDataCacheFile, "_load_index", slow)
    files = [type(_half._cache._cache_file)(str(tmp_path), "half", "stamp") for _ in range(2)]
    with ThreadPoolExecutor(2) as threads:
        list(threads.map(lambda one, key: one.save(key, f"code for {key}"), files, "ab"))
    assert [files[0].load(key) for key in "ab"] == ["code for a", "code for b"]


def test_a_process_that_is_paused_holds_up_no_other_one(tmp_path, monkeypatch):
    monkeypatch.setattr(decorators, "_PATIENCE", 0.2)
    files = type(_half._cache._cache_file)(str(tmp_path), "half", "stamp")
    held = lock(tmp_path / decorators._LOCK)
    try:
        saving = threading.Thread(target=files.save, args=("a", "code for a"), daemon=True)
        saving.start()
        saving.join(20)
        assert not saving.is_alive() and files.load("a") == "code for a"
    finally:
        held.release()


def test_what_an_earlier_version_left_is_compiled_again(tmp_path):
    files = type(_half._cache._cache_file)(str(tmp_path), "half", "stamp")
    files.save("a", "code for a")
    with open(files._index_path, "rb") as stream:
        version = pickle.load(stream)
    with open(files._index_path, "wb") as stream:
        pickle.dump(version, stream)
        stream.write(b"clfportrait.a_module_that_was\nLanes\n.")  # a type by its old name
    assert files.load("a") is None
    files.save("a", "code for a")
    assert files.load("a") == "code for a"


def test_every_kernel_has_the_same_key_in_every_process(tmp_path):
    # The first process compiles all modules from their sources, the next reads their bytecode.
    shutil.copytree(Path(lfportrait.__file__).parent, tmp_path / "lfportrait",
                    ignore=shutil.ignore_patterns("__pycache__"))
    first, second = (run(KEYS, PYTHONHASHSEED=seed, PYTHONPATH=str(tmp_path)).stdout
                     for seed in ("1", "2"))
    assert str(tmp_path) in first
    assert first == second
    assert len(set(first.splitlines())) == 6
