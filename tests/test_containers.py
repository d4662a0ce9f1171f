"""What a container leaves of the machine, read from folders that look like Linux' accounts."""

import os

import pytest

from lfportrait.measure import (
    THREADS,
    core_quota,
    free_in_groups,
    free_memory_bytes,
    limit_threads,
    usable_cores,
)

GIB = 1 << 30


def files(root, **texts):
    """Files by their paths, of which ``__`` parts the folders."""
    for name, text in texts.items():
        path = root.joinpath(*name.split("__"))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{text}\n")


def group(root, place, **entries):
    """A group's folder below ``sys/fs/cgroup``."""
    for name, text in entries.items():
        path = root / "sys/fs/cgroup" / place / name.replace("__", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{text}\n")


def test_files_that_the_kernel_keeps_are_no_used_memory(tmp_path):
    files(tmp_path, proc__meminfo=f"MemAvailable: {60 << 20} kB")
    group(tmp_path, "", memory__max=7 * GIB, memory__current=int(6.5 * GIB),
          memory__stat=f"anon {GIB // 2}\nfile {6 * GIB}\ninactive_file {6 * GIB}\nactive_file 0")
    assert free_memory_bytes(tmp_path) == int(6.5 * GIB)


def test_working_set_is_never_below_nothing(tmp_path):
    group(tmp_path, "", memory__max=100, memory__current=10, memory__stat="inactive_file 40")
    assert free_in_groups(tmp_path) == 100


@pytest.mark.parametrize(("outer", "inner", "free"), [
    ((500, 100), (900, 50), 400), ((900, 800), (500, 50), 100), (("max", 1), (500, 50), 450),
    ((500, 100), ("max", 50), 400), (("max", 1), ("max", 1), None)])
def test_the_tightest_group_on_the_way_counts(tmp_path, outer, inner, free):
    files(tmp_path, proc__self__cgroup="0::/a/b")
    for place, (limit, used) in (("a", outer), ("a/b", inner)):
        group(tmp_path, place, memory__max=limit, memory__current=used)
    group(tmp_path, "other", memory__max=1, memory__current=1)
    assert free_in_groups(tmp_path) == free


def test_a_limit_that_slows_down_is_a_limit(tmp_path):
    group(tmp_path, "", memory__max=900, memory__high=300, memory__current=100)
    assert free_in_groups(tmp_path) == 200


def test_version_1_has_other_names_and_no_limit_is_a_large_one(tmp_path):
    files(tmp_path, proc__self__cgroup="4:memory:/job\n3:cpu,cpuacct:/job")
    group(tmp_path, "memory", memory__limit_in_bytes=9223372036854771712,
          memory__usage_in_bytes=5, memory__stat="total_inactive_file 1")
    assert free_in_groups(tmp_path) is None
    group(tmp_path, "memory/job", memory__limit_in_bytes=1000, memory__usage_in_bytes=700,
          memory__stat="inactive_file 1\ntotal_inactive_file 200")
    assert free_in_groups(tmp_path) == 500


def test_both_versions_at_once(tmp_path):
    """Memory is accounted by version 1 while version 2 has nothing but processes."""
    files(tmp_path, proc__self__cgroup="4:memory:/job\n1:cpu:/\n0::/job",
          proc__self__mountinfo="\n".join([
              "32 31 0:29 / /sys/fs/cgroup/cpu rw - cgroup cgroup rw,cpu",
              "35 31 0:32 / /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory",
              "41 31 0:38 / /sys/fs/cgroup/unified rw - cgroup2 cgroup2 rw"]))
    group(tmp_path, "unified/job", cgroup__procs="1")
    group(tmp_path, "memory/job", memory__limit_in_bytes=1000, memory__usage_in_bytes=700)
    group(tmp_path, "cpu", cpu__cfs_quota_us=300000, cpu__cfs_period_us=100000)
    assert free_in_groups(tmp_path) == 300 and core_quota(tmp_path) == 3


def test_a_group_that_is_the_root_here_and_has_a_name_outside(tmp_path):
    files(tmp_path, proc__self__cgroup="4:memory:/docker/abc/task",
          proc__self__mountinfo="35 31 0:32 /docker/abc /groups/m rw - cgroup cgroup rw,memory")
    for place, limit in (("groups/m", 800), ("groups/m/task", 600)):
        folder = tmp_path / place
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "memory.limit_in_bytes").write_text(str(limit))
        (folder / "memory.usage_in_bytes").write_text("100")
    assert free_in_groups(tmp_path) == 500


@pytest.mark.parametrize(("quota", "cores"), [
    ("200000 100000", 2), ("150000 100000", 2), ("5000 100000", 1), ("max 100000", None),
    ("", None)])
def test_cores_by_time(tmp_path, quota, cores):
    group(tmp_path, "", cpu__max=quota)
    assert core_quota(tmp_path) == cores


def test_the_tightest_quota_on_the_way_counts(tmp_path):
    files(tmp_path, proc__self__cgroup="0::/pod/box")
    group(tmp_path, "pod", cpu__max="300000 100000")
    group(tmp_path, "pod/box", cpu__max="max 100000")
    assert core_quota(tmp_path) == 3


def test_version_1_has_no_quota_at_minus_one(tmp_path):
    group(tmp_path, "cpu", cpu__cfs_quota_us=-1, cpu__cfs_period_us=100000)
    assert core_quota(tmp_path) is None


def test_usable_cores_are_those_of_the_process_or_of_its_group(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(64)), raising=False)
    assert usable_cores(tmp_path) == 64
    group(tmp_path, "", cpu__max="200000 100000")
    assert usable_cores(tmp_path) == 2
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {5})
    assert usable_cores(tmp_path) == 1


def test_libraries_get_no_more_threads_than_cores(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(64)), raising=False)
    free, limited = {}, {"OMP_NUM_THREADS": "7"}
    limit_threads(free, tmp_path)
    group(tmp_path, "", cpu__max="200000 100000")
    limit_threads(limited, tmp_path)
    assert free == {}
    assert limited == {**dict.fromkeys(THREADS, "2"), "OMP_NUM_THREADS": "7"}


def test_kernels_get_no_more_threads_than_cores(monkeypatch):
    import numba

    from lfportrait import simd

    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 64)
    monkeypatch.setattr(simd, "usable_cores", lambda: 2)
    monkeypatch.setenv("NUMBA_NUM_THREADS", "64")
    simd.limit_threads()
    assert numba.config.NUMBA_NUM_THREADS == 64  # as asked for
    monkeypatch.delenv("NUMBA_NUM_THREADS")
    simd.limit_threads()
    assert numba.config.NUMBA_NUM_THREADS == 2


def test_only_one_place_counts_cores():
    """Whoever counts by itself does not know of containers."""
    from pathlib import Path

    import lfportrait

    package = Path(lfportrait.__file__).parent
    counting = {path.name for folder in (package, package.with_name("lfportrait_eval"))
                for path in folder.rglob("*.py")
                if any(name in path.read_text("utf-8") for name in ("cpu_count", "sched_getaff"))}
    assert counting == {"measure.py"}
