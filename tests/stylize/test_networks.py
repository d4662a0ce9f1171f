"""Tests of what the feature networks share with the process that they run in."""

import os
import subprocess
import sys

import pytest

ASK = "import numba; numba.get_num_threads()"
LOAD = "import lfportrait.stylize.losses"


@pytest.mark.parametrize("order", [
    (ASK, LOAD), pytest.param((LOAD, ASK), marks=pytest.mark.slow)])
def test_torch_has_as_many_threads_as_openmp_was_given_whatever_numba_loads(order):
    # Sums depend on the number in their last digits: a job that was resumed would differ.
    program = "\n".join([*order, "import torch", "print(torch.get_num_threads())"])
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True,
                          env={**os.environ, "OMP_NUM_THREADS": "1"}, check=True)
    assert said.stdout.split() == ["1"]
