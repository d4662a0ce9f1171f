"""The next process finds compiled kernels again: compiling takes seconds, loading does not."""

import os
import subprocess
import sys
from pathlib import Path

SCRIPT = """
from lfportrait.capture import Camera
from lfportrait.field.kernels.render import render_kernel
from tests.fields import shell_field

camera = Camera.arc([0.0], distance=3.0, width=8, height=8, focal=8.0)
shell_field(size=12, basis=1).render(camera)
stats = render_kernel(16).stats
print(sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
"""

KEYS = """
import hashlib
from numba.core.serialize import dumps
from lfportrait.lightfield.kernels.encode import encode_kernel
from lfportrait.field.kernels.render import render_kernel_one_lane
from lfportrait.field.kernels.train import train_kernel

for kernel in (train_kernel(32), encode_kernel(32, 9), render_kernel_one_lane(32)):
    cells = tuple(cell.cell_contents for cell in kernel.py_func.__closure__)
    print(kernel.py_func.__name__, hashlib.sha256(dumps(cells)).hexdigest())
"""


TWINS = """
import sys
import numpy as np
from tests.field.test_raycast import Training

for basis in map(int, sys.argv[1:]):
    field = Training(basis)
    losses, density, sh = field.run(field.field.density, field.field.sh)
    print(basis, losses.sum(), np.abs(density).sum(), np.abs(sh).sum())
"""


def run(script, *arguments, **environment):
    result = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True,
                            text=True, check=True, cwd=Path(__file__).parents[2],
                            env={**os.environ, **environment})
    return result.stdout


def test_the_second_process_compiles_nothing(tmp_path):
    hits = [run(SCRIPT, NUMBA_CACHE_DIR=str(tmp_path)).split() for _ in range(2)]
    assert hits == [["0", "1"], ["1", "0"]]


def test_every_kernel_has_the_same_key_in_every_process():
    first, second = (run(KEYS, PYTHONHASHSEED=seed) for seed in ("1", "2"))
    assert first == second
    assert len(set(first.split())) == 6


def test_products_of_one_factory_compiled_apart_work_together(tmp_path):
    # Each process numbers its functions anew: their symbols must differ by more than the number.
    apart = "".join(run(TWINS, basis, NUMBA_CACHE_DIR=str(tmp_path)) for basis in ("9", "1"))
    assert run(TWINS, "9", "1", NUMBA_CACHE_DIR=str(tmp_path)) == apart
