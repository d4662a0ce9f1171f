"""What kernels find on this machine."""

import os
import subprocess
import sys
from pathlib import Path

import llvmlite.binding
import pytest

from lfportrait.simd import host


@pytest.mark.parametrize("features, unit", [
    ({"avx512f": True, "avx2": True}, ("AVX-512", 16)), ({"avx512f": False, "avx2": True},
                                                        ("AVX2", 8)),
    ({"neon": True}, ("NEON", 4)), ({}, ("none", 1))])
def test_the_widest_unit_counts(monkeypatch, features, unit):
    monkeypatch.delenv("LFPORTRAIT_VECTORS", raising=False)
    monkeypatch.setattr(llvmlite.binding, "get_host_cpu_features", lambda: features)
    assert host.vector_unit() == unit


def looked_up(**settings: str) -> tuple[Path, int]:
    """Folder of the cache and its number of functions, as another process finds them."""
    code = ("from lfportrait.simd.host import kernel_cache; found = kernel_cache()\n"
            "print(found.folder, found.functions, sep='\\n')")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          env={**os.environ, **settings})
    folder, functions = done.stdout.splitlines()
    return Path(folder), int(functions)


def test_the_cache_is_where_numba_keeps_it(tmp_path):
    assert looked_up(NUMBA_CACHE_DIR="")[0] == Path(host.__file__).parents[1]
    assert looked_up(NUMBA_CACHE_DIR=str(tmp_path / "new")) == (tmp_path / "new", 0)


def test_functions_and_bytes_are_counted(monkeypatch, tmp_path):
    monkeypatch.setattr(host, "_cache_folder", lambda home: tmp_path / home.parent.name)
    homes = [tmp_path / name for name in ("field", "lightfield")]
    for home in homes:
        home.mkdir()
        (home / "march-1.py311.nbi").write_bytes(b"12")
        (home / "march-1.py311.1.nbc").write_bytes(b"345")
        (home / "march.cpython-311.pyc").write_bytes(b"other")
    assert host.kernel_cache() == host.KernelCache(tmp_path, 2, 10)


def test_no_folder_to_keep_kernels_in(monkeypatch):
    def nowhere(home):
        raise RuntimeError("no locator available")

    monkeypatch.setattr(host, "_cache_folder", nowhere)
    assert host.kernel_cache() == host.KernelCache(None, 0, 0)
