"""The next process finds compiled kernels again: compiling takes seconds, loading does not."""

import os
import subprocess
import sys
from pathlib import Path

SCRIPT = """
from lfportrait.capture import Camera
from lfportrait.kernels.render import render_kernel
from tests.fields import shell_field

camera = Camera.arc([0.0], distance=3.0, width=8, height=8, focal=8.0)
shell_field(size=12, basis=1).render(camera)
stats = render_kernel(16).stats
print(sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
"""

KEYS = """
import hashlib
from numba.core.serialize import dumps
from lfportrait.kernels.encode import encode_kernel
from lfportrait.kernels.render import render_kernel_one_lane
from lfportrait.kernels.train import train_kernel

for kernel in (train_kernel(32), encode_kernel(32, 9), render_kernel_one_lane(32)):
    cells = tuple(cell.cell_contents for cell in kernel.py_func.__closure__)
    print(kernel.py_func.__name__, hashlib.sha256(dumps(cells)).hexdigest())
"""


def run(script, **environment):
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True,
                            check=True, cwd=Path(__file__).parents[1],
                            env={**os.environ, **environment})
    return result.stdout


def test_the_second_process_compiles_nothing(tmp_path):
    hits = [run(SCRIPT, NUMBA_CACHE_DIR=str(tmp_path)).split() for _ in range(2)]
    assert hits == [["0", "1"], ["1", "0"]]


def test_every_kernel_has_the_same_key_in_every_process():
    first, second = (run(KEYS, PYTHONHASHSEED=seed) for seed in ("1", "2"))
    assert first == second
    assert len(set(first.split())) == 6
