"""The process of a GPU: calls, its end, and another start."""

import subprocess
import sys
import time
import warnings

import numpy as np
import pytest

from lfportrait.errors import UserError
from lfportrait.gpu import LIMITS, Adapter, GpuLostError, GpuProcess, adapters, attempted, chosen

WORK = "tests.gpu_work:"


@pytest.fixture(scope="module")
def process(adapter):
    one = GpuProcess(adapter)
    yield one
    one.close()


@pytest.mark.slow  # a device; a panel is coded in tests/lightfield/gpu
def test_arrays_go_in_and_out(process):
    values = np.random.default_rng(0).normal(size=1001).astype(np.float32)
    np.testing.assert_array_equal(process.call(WORK + "double", values), 2 * values)
    mixed = (np.arange(7, dtype=np.int8)[::2], "text", {"a": 1}, np.zeros((0, 3), np.float32))
    got = process.call(WORK + "echo", *mixed)
    np.testing.assert_array_equal(got[0], mixed[0])
    assert got[1:3] == mixed[1:3] and got[3].shape == (0, 3)
    got[0][:] = 5  # a result is the caller's own


@pytest.mark.slow  # a device
def test_a_device_has_the_default_limits_whatever_the_card_could(process):
    limits = process.call(WORK + "limits")
    asked = ("max-storage-buffer-binding-size", "max-buffer-size")
    assert {name: limits[name] for name in asked} == {name: LIMITS[name] for name in asked}


@pytest.mark.slow  # a device
@pytest.mark.parametrize("size", [(1, 1), (3, 5), (257, 130)])
def test_textures_of_odd_sizes_are_filled(process, size):
    texels = np.random.default_rng(1).integers(0, 256, (*size, 4)).astype(np.uint8)
    np.testing.assert_array_equal(process.call(WORK + "texture_back", texels), texels)


@pytest.mark.slow  # a device
def test_an_error_there_is_an_error_here_and_the_process_lives_on(process):
    starts = process.starts
    with pytest.raises(ValueError, match="no such thing"):
        process.call(WORK + "wrong")
    with pytest.raises(RuntimeError, match=r"(?i)validation|shader"):
        process.call(WORK + "bad_shader")
    assert process.call(WORK + "print_much") == 7
    assert process.starts == starts


@pytest.mark.slow  # a device
def test_bands_cover_all_rows_once(process):
    for total in (1, 2, 7, 100):
        size, seen = process.call(WORK + "banded", total)
        assert size >= 1
        assert [row for since, until in seen for row in range(since, until)] == list(range(total))


@pytest.mark.slow  # one that is lost: below
def test_what_is_kept_is_forgotten_with_the_process(adapter):
    own = GpuProcess(adapter)
    own.note("fields", own.call(WORK + "keep", "a", 1))
    assert own.holds("fields", "a") and not own.holds("fields", "b")
    own.close()
    assert not own.holds("fields", "a")


@pytest.mark.slow  # one that is gone: below
def test_a_lost_device_is_replaced_once_and_then_given_up(adapter):
    own = GpuProcess(adapter)
    with pytest.raises(GpuLostError, match="was lost"):
        own.call(WORK + "die")
    np.testing.assert_array_equal(own.call(WORK + "double", np.ones(3, np.float32)), 2)
    with pytest.raises(GpuLostError, match="was lost"):
        own.call(WORK + "die")
    with pytest.raises(GpuLostError, match="lost twice"):
        own.call(WORK + "double", np.ones(3, np.float32))
    own.close()


@pytest.mark.slow  # one that is lost: above
def test_a_driver_that_hangs_is_ended(adapter):
    own = GpuProcess(adapter)
    own.call(WORK + "echo")  # its start may take long
    own.timeout = 0.5
    start = time.monotonic()
    with pytest.raises(GpuLostError, match=r"did not answer within 0\.5 s"):
        own.call(WORK + "hang")
    assert time.monotonic() - start < 50  # it would hang for a minute
    own.close()


@pytest.mark.slow  # one that is lost: above
def test_work_that_can_not_be_done_leaves_a_line_and_the_caller_goes_on(adapter, monkeypatch):
    own = GpuProcess(adapter)
    monkeypatch.setattr("lfportrait.gpu.gpu_process", lambda _: own)
    with pytest.warns(UserWarning, match="too little memory.*: the CPU computes instead"):
        assert attempted(adapter, lambda one: one.call(WORK + "lose_memory")) is None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert attempted(None, lambda one: one.call(WORK + "lose_memory")) is None
        assert attempted(adapter, lambda one: one.call(WORK + "print_much")) == 7
    own.close()


def test_an_adapter_that_is_gone_is_a_lost_one():
    own = GpuProcess(Adapter("none", "discrete", "Vulkan"))
    with pytest.raises(GpuLostError, match=r"can't be used|was lost"):
        own.call(WORK + "echo")
    own.close()


@pytest.mark.slow  # other processes do: tests/runner/test_processes.py
def test_the_child_ends_with_its_parent(adapter):
    code = ("import os, sys; from lfportrait.gpu import GpuProcess, adapters;"
            "found = [one for one in adapters() if one.title == sys.argv[1]];"
            "own = GpuProcess(found[0]); own.call('tests.gpu_work:echo');"
            "print(own._child.number, flush=True); os.kill(os.getpid(), 9)")
    done = subprocess.run([sys.executable, "-c", code, adapter.title], capture_output=True,
                          text=True, check=False)
    child = int(done.stdout)
    until = time.monotonic() + 60
    while time.monotonic() < until:
        # Ended, or a zombie that nobody waited for.
        state = subprocess.run(["ps", "-o", "stat=", "-p", str(child)], capture_output=True,
                               text=True, check=False).stdout.strip()
        if not state or state.startswith("Z"):
            return
        time.sleep(0.1)
    pytest.fail("the child outlives its parent")


def test_the_software_adapter_is_taken_only_if_asked_for(adapter):
    assert chosen("cpu") is None
    real = [one for one in adapters() if one.real]
    assert chosen("auto") == (real[0] if real else None)
    assert chosen("gpu") in adapters()
    assert chosen(f"gpu:{adapter.name[:5]}") in adapters()
    with pytest.raises(UserError, match="there are"):
        chosen("gpu:no such card")
