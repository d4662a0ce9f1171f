"""What is free on a machine."""

import os
import platform
import shutil

import numpy as np
import pytest

from lfportrait.measure import free_disk_bytes, free_memory_bytes, give_back_memory


def machine(root, available, limit=None, used=0):
    (root / "proc").mkdir(parents=True)
    (root / "proc/meminfo").write_text(
        f"MemTotal:       9000000 kB\nMemAvailable:   {available} kB\nSwapFree:  0 kB\n")
    if limit is not None:
        (root / "sys/fs/cgroup").mkdir(parents=True)
        (root / "sys/fs/cgroup/memory.max").write_text(f"{limit}\n")
        (root / "sys/fs/cgroup/memory.current").write_text(f"{used}\n")
    return root


def test_free_memory_is_the_systems_or_the_containers(tmp_path):
    assert free_memory_bytes(machine(tmp_path / "plain", 5000)) == 5000 * 1024
    assert free_memory_bytes(machine(tmp_path / "box", 5000, 3_000_000, 1_000_000)) == 2_000_000
    assert free_memory_bytes(machine(tmp_path / "wide", 5000, "max", 1)) == 5000 * 1024
    assert free_memory_bytes(machine(tmp_path / "full", 5000, 10, 20)) == 0
    assert free_memory_bytes(tmp_path / "elsewhere") is None


def test_free_disk_of_a_folder_that_is_not_there_yet(tmp_path):
    free = free_disk_bytes(tmp_path / "not" / "yet")
    assert abs(free - shutil.disk_usage(tmp_path).free) < 2**30
    assert not (tmp_path / "not").exists()


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library")
def test_memory_between_what_is_kept_is_given_back():
    def resident():
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    pieces = [np.ones(8000) for _ in range(1000)]
    kept = pieces[::10]
    del pieces
    before = resident()
    give_back_memory()
    assert before - resident() > 20e6
    assert all(piece.sum() == 8000 for piece in kept)
