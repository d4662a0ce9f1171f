"""Kernels compiled ahead: told as they come, and found again."""

import subprocess
import sys
import time

import numba
import numpy as np
import pytest

from lfportrait.job import warmup
from lfportrait.job.warmup import (
    FUNCTIONS,
    Warmup,
    ball_capture,
    ball_field,
    ball_points,
    drawn_exemplar,
)
from lfportrait.simd.host import compiling_progress, watched_compilations

ONE = "import sys; from lfportrait.job.warmup import run_stage; run_stage('encode')"


def run(script, *arguments):
    return subprocess.run([sys.executable, "-c", script, *arguments], check=True, text=True,
                          stdout=subprocess.PIPE).stdout.split()


@pytest.mark.slow  # nor does the job of test_pipeline.py, in a process of its own
def test_the_second_run_compiles_nothing():
    with Warmup(("encode",)) as ahead:  # another process has compiled it
        ahead.wait(("encode",))
    assert run(ONE) == []


def test_stages_that_were_compiled_start_no_process(monkeypatch, tmp_path):
    for name in FUNCTIONS:
        (tmp_path / name).touch()
    monkeypatch.setattr(warmup, "_mark", lambda name: tmp_path / name)
    monkeypatch.setattr(warmup, "Child", None)
    with Warmup(tuple(FUNCTIONS)) as ahead:
        ahead.wait(tuple(FUNCTIONS))
        assert ahead.total == 0


@pytest.mark.parametrize("setting", ["CPU_NAME", "CPU_FEATURES"])
def test_code_for_other_instructions_is_not_taken_for_this(setting, monkeypatch):
    mark = warmup._mark.__wrapped__
    before = mark("encode")
    assert mark("encode") == before
    monkeypatch.setattr(numba.config, setting, "something else")
    assert mark("encode") != before


def test_what_is_not_waited_for_ends_with_the_job(monkeypatch, tmp_path):
    monkeypatch.setattr(warmup, "_mark", lambda name: tmp_path / name)
    start = time.monotonic()
    with Warmup(("reconstruct", "transfer")) as ahead:
        assert ahead.total == FUNCTIONS["reconstruct"] + FUNCTIONS["transfer"]
    assert time.monotonic() - start < 60
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow  # a process of its own
def test_a_stage_that_fails_is_left_to_the_job(monkeypatch, tmp_path):
    monkeypatch.setattr(warmup, "_mark", lambda name: tmp_path / name)
    monkeypatch.setitem(FUNCTIONS, "no such stage", 3)
    with Warmup(("no such stage",)) as ahead:
        ahead.wait(("no such stage",))
    assert list(tmp_path.iterdir()) == []


def test_progress_tells_of_kernels_that_are_compiled_meanwhile(monkeypatch):
    notes = []

    class Watch:
        """Numba's part: two functions of ours are compiled."""

        def __init__(self, heard):
            self.heard = heard

        def __enter__(self):
            self.heard("one")
            self.heard("two")

        def __exit__(self, *_):
            pass

    from lfportrait.progress import Progress
    from lfportrait.simd import host
    monkeypatch.setattr(host, "watched_compilations", Watch)
    monkeypatch.setattr(Progress, "update", lambda self, done, note="": notes.append(note))
    with compiling_progress("title", enabled=False):
        pass
    assert notes == ["compiling kernels, once: 1", "compiling kernels, once: 2"]


def test_only_our_own_compilations_are_heard_of():
    seen = []
    with watched_compilations(seen.append):
        assert numba.njit(lambda x: x + 1)(1) == 2
    assert seen == []


def test_specimens_are_what_they_stand_for():
    capture, exemplar, field = ball_capture(), drawn_exemplar(), ball_field(9)
    points = ball_points(capture.cameras, 0)
    assert np.nanmax(np.abs(np.linalg.norm(points, axis=-1) - 0.6)) < 1e-9
    assert np.array_equal(np.isfinite(points[..., 0]), capture.alphas[0] > 0)
    assert capture.landmarks.shape == (68, 3) and exemplar.landmarks.shape == (68, 2)
    assert np.linalg.norm(capture.landmarks, axis=1) == pytest.approx(0.6)
    shot = field.render(capture.cameras, len(capture) // 2)
    assert 0.05 < shot.alpha.mean() < 0.6
