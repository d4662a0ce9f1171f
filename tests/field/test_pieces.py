"""Arrays that all cores deflate and inflate: others read them, and damage is found."""

import zipfile

import numpy as np
import pytest

from lfportrait.field.storage import read_array, write_array
from lfportrait.files import UNREADABLE_ARRAYS

RANDOM = np.random.default_rng(0)
ARRAYS = {"table": RANDOM.integers(0, 4, (600, 1200), np.int32),
          "halves": RANDOM.normal(0, 1, (40_000, 27)).astype(np.float16),
          "columns": np.asfortranarray(RANDOM.random((700, 300))), "one": np.float64(3.5),
          "none": np.zeros((0, 3), np.int32), "words": np.array(["head", "häir"])}


@pytest.fixture
def path(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in ARRAYS.items():
            write_array(archive, name, np.asanyarray(array), noisy=name == "halves")
    return tmp_path / "a.npz"


@pytest.mark.parametrize("name", ARRAYS)
def test_what_is_written_comes_back_and_others_read_it(path, name):
    found = read_array(path, name)
    with np.load(path, allow_pickle=False) as data:
        for other in (data[name], ARRAYS[name]):
            assert found.dtype == other.dtype and np.array_equal(found, other)
    assert found.flags.aligned and found.flags.writeable
    assert found.flags.f_contiguous == np.asarray(ARRAYS[name]).flags.f_contiguous


def test_an_archive_is_whole_and_smaller(path):
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        assert archive.getinfo("table.npy").compress_size < ARRAYS["table"].nbytes / 4


def test_other_files_are_read_too(tmp_path):
    np.savez(tmp_path / "stored.npz", **ARRAYS)
    np.savez_compressed(tmp_path / "deflated.npz", **ARRAYS)
    for name, array in ARRAYS.items():
        for kind in ("stored", "deflated"):
            assert np.array_equal(read_array(tmp_path / f"{kind}.npz", name), array)
    np.savez(tmp_path / "objects.npz", one=np.array([{}], object))
    with pytest.raises(UNREADABLE_ARRAYS):
        read_array(tmp_path / "objects.npz", "one")
    with pytest.raises(UNREADABLE_ARRAYS):
        read_array(tmp_path / "stored.npz", "two")


def test_damage_is_found(path):
    whole = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        member = archive.getinfo("halves.npy")
    for place in (0.1, 0.5, 0.9):
        bad = bytearray(whole)
        bad[member.header_offset + int(place * member.compress_size)] ^= 4
        path.write_bytes(bad)
        with pytest.raises(UNREADABLE_ARRAYS):
            read_array(path, "halves")


def test_a_damaged_directory_gives_no_other_numbers(path):
    whole = path.read_bytes()
    directory = whole.rindex(b"halves.npy") + len("halves.npy")
    refused = 0
    for place in range(60):
        bad = bytearray(whole)
        bad[directory + place] ^= 1
        path.write_bytes(bad)
        try:
            assert np.array_equal(read_array(path, "halves"), ARRAYS["halves"])
        except UNREADABLE_ARRAYS:
            refused += 1
    assert refused > 30
