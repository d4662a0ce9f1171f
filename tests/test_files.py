"""Files that appear whole or not at all; arrays that are mapped rather than read."""

import ast
import contextlib
import errno
import os
import signal
import subprocess
import sys
import threading
import zipfile
from concurrent.futures import ThreadPoolExecutor

import filelock
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from lfportrait.errors import UserError
from lfportrait.files import load_arrays, lock, map_arrays, read_json, write_json, write_mappable

ARRAYS = {"shares": np.linspace(0, 1, 7, dtype=np.float16), "words": np.array(["skin", "häir"]),
          "one": np.float64(3.5), "none": np.zeros((0, 3), np.int32),
          "plane": np.arange(12, dtype=np.int32).reshape(3, 4), "inside": np.array([True, False]),
          "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3))}


def written(path, named):
    with open(path, "wb") as stream:
        write_mappable(stream, named)
    return path


def test_what_is_mapped_is_what_was_written(tmp_path):
    path = written(tmp_path / "a.npz", ARRAYS)
    mapped = map_arrays(path)
    with np.load(path) as data:
        assert list(mapped) == data.files == list(ARRAYS)
        for name, array in ARRAYS.items():
            assert mapped[name].dtype == data[name].dtype == array.dtype
            assert np.array_equal(mapped[name], array) and np.array_equal(data[name], array)
            assert mapped[name].shape == array.shape


@settings(max_examples=40, deadline=None)
@given(st.dictionaries(
    st.text("abcdefgh_", min_size=1, max_size=40), max_size=5,
    values=arrays.arrays(st.sampled_from([np.uint8, np.int32, np.float32, np.float64]),
                         arrays.array_shapes(max_dims=3, max_side=5))))
def test_numbers_are_aligned(tmp_path_factory, named):
    mapped = map_arrays(written(tmp_path_factory.mktemp("mapped") / "a.npz", named))
    assert mapped.keys() == named.keys()
    for name, array in mapped.items():
        assert array.flags.aligned and array.ctypes.data % 64 == 0
        assert array.tobytes() == named[name].tobytes()


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_what_is_loaded_is_what_numpy_loads(tmp_path, save):
    save(tmp_path / "a.npz", **ARRAYS, large=np.arange(400_000.0))
    loaded = load_arrays(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as data:
        assert list(loaded) == data.files
        for name, array in loaded.items():
            assert array.dtype == data[name].dtype and np.array_equal(array, data[name])
            assert array.flags.writeable and array.flags.fnc == data[name].flags.fnc


def test_nothing_is_parsed_as_python(tmp_path, monkeypatch):
    """CPython 3.11 fails now and then where two threads parse at once."""
    path = written(tmp_path / "a.npz", ARRAYS)
    monkeypatch.setattr(ast, "literal_eval", lambda text: pytest.fail(f"{text} is parsed"))
    for read in (load_arrays, map_arrays):
        assert {name: array.shape for name, array in read(path).items()} == {
            name: array.shape for name, array in ARRAYS.items()}


def test_what_is_written_to_an_array_stays_in_memory(tmp_path):
    path = written(tmp_path / "a.npz", ARRAYS)
    before = path.read_bytes()
    mapped = map_arrays(path)["plane"]
    mapped += 1
    assert np.array_equal(mapped, ARRAYS["plane"] + 1)
    assert path.read_bytes() == before and np.array_equal(map_arrays(path)["plane"],
                                                          ARRAYS["plane"])


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    with pytest.raises(OSError):
        map_arrays(path)
    np.savez_compressed(path, a=np.zeros(100))
    with pytest.raises(ValueError, match="compressed"):
        map_arrays(path)
    whole = written(path, ARRAYS).read_bytes()
    for part in (b"", whole[:50], whole[:-30], whole[:len(whole) // 2]):
        path.write_bytes(part)
        with pytest.raises((ValueError, zipfile.BadZipFile)):
            map_arrays(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("plane.npy", written(tmp_path / "b.npz", ARRAYS).read_bytes()[:60])
    with pytest.raises(ValueError):
        map_arrays(path)


@pytest.mark.skipif(os.name != "posix", reason="permissions of another kind")
def test_threads_that_write_at_a_time_leave_the_permissions_of_new_files(tmp_path, monkeypatch):
    """Only the process has a umask: a thread must not take another one's for a moment for it."""
    real, both, lock = os.umask, threading.Barrier(2), threading.Lock()
    waited = []

    def slow(mask):
        before = real(mask)
        with lock:
            first = len(waited) < 2
            waited.append(mask)
        if first and mask == 0:
            with contextlib.suppress(threading.BrokenBarrierError):
                both.wait(0.2)  # the other thread has read it, too, where nothing holds it up
        return before

    before = real(0o027)
    try:
        monkeypatch.setattr(os, "umask", slow)
        with ThreadPoolExecutor(2) as threads:
            list(threads.map(lambda name: write_json(tmp_path / name, [1]), "ab"))
        assert [path.stat().st_mode & 0o777 for path in sorted(tmp_path.iterdir())] == [0o640] * 2
        assert real(0o027) == 0o027
    finally:
        real(before)


def test_file_systems_without_permissions_or_renaming_over(tmp_path, monkeypatch):
    """Memory cards and network drives refuse one or the other; the file is written all the same."""
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "chmod", refuse)
    monkeypatch.setattr(os, "replace", refuse)
    path = tmp_path / "a.json"
    path.write_text("old")
    write_json(path, [1])
    assert read_json(path) == [1]
    assert [one.name for one in tmp_path.iterdir()] == ["a.json"]
    monkeypatch.setattr(os, "rename", refuse)
    with pytest.raises(UserError, match="can't write"):
        write_json(path, [2])
    assert read_json(path) == [1] and len(list(tmp_path.iterdir())) == 1


HOLDER = """
import sys, time
from pathlib import Path
from lfportrait.files import lock
held = lock(Path(sys.argv[1]))
print("locked", flush=True)
time.sleep(600)
"""
WAITER = """
import signal, sys
from pathlib import Path
from lfportrait.files import lock
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background ignores it
try:
    print("waiting", flush=True)
    lock(Path(sys.argv[1]), wait=-1)
except KeyboardInterrupt:
    sys.exit(130)
"""


def begun(script, path, word):
    """A process that says that it began."""
    process = subprocess.Popen([sys.executable, "-c", script, str(path)], stdout=subprocess.PIPE,
                               text=True)
    assert process.stdout.readline() == f"{word}\n"
    return process


@pytest.fixture
def holder(tmp_path):
    """A process that has a file locked."""
    process = begun(HOLDER, tmp_path / "lock", "locked")
    yield process
    process.kill()
    process.wait()


def test_a_lock_goes_with_its_process(tmp_path, holder):
    with pytest.raises(filelock.Timeout):
        lock(tmp_path / "lock")
    holder.kill()
    lock(tmp_path / "lock", wait=-1).release()
    lock(tmp_path / "lock").release()


def test_waiting_for_a_lock_can_be_interrupted(tmp_path, holder):
    waiting = begun(WAITER, tmp_path / "lock", "waiting")
    with pytest.raises(subprocess.TimeoutExpired):
        waiting.wait(0.3)
    waiting.send_signal(signal.SIGINT)
    assert waiting.wait() == 130


def test_a_drive_without_locks_is_written_to(tmp_path, monkeypatch):
    def none(self):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(filelock.FileLock, "_acquire", none)
    lock(tmp_path / "lock").release()


def test_a_folder_that_cant_be_written_to_is_no_drive_without_locks(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError, match="file") as caught:
        lock(tmp_path / "file" / "lock")
    assert not isinstance(caught.value, filelock.Timeout)
