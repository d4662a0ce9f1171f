"""Hashes of what things are made of, and what is kept under them."""

import os

import numpy as np
import pytest

from lfportrait import keys
from lfportrait.keys import code_hash, kept_arrays, user_cache


@pytest.fixture
def make():
    """Makes an array, and counts how often."""
    def made():
        made.times += 1
        return {"one": np.arange(3.0), "two": np.array("words")}
    made.times = 0
    return made


def test_arrays_are_made_once(make, tmp_path):
    first = kept_arrays("things", "a", make, tmp_path / "kept")
    again = kept_arrays("things", "a", make, tmp_path / "kept")
    assert make.times == 1 and first.keys() == again.keys()
    assert np.array_equal(first["one"], again["one"]) and str(again["two"]) == "words"
    kept_arrays("things", "b", make, tmp_path / "kept")
    assert make.times == 2


def test_a_damaged_file_is_made_anew(make, tmp_path):
    kept_arrays("things", "a", make, tmp_path)
    whole = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(whole[:len(whole) // 2])
    assert np.array_equal(kept_arrays("things", "a", make, tmp_path)["one"], np.arange(3.0))
    assert make.times == 2 and (tmp_path / "a.npz").read_bytes() == whole


def test_where_nothing_can_be_written_they_are_made_each_time(make, tmp_path):
    (tmp_path / "taken").write_text("a file, no folder")
    for _ in range(2):
        assert kept_arrays("things", "a", make, tmp_path / "taken")["one"][2] == 2
    assert make.times == 2


def test_what_was_not_used_for_long_goes(make, tmp_path, monkeypatch):
    monkeypatch.setattr(keys, "MOST", 3)
    for age, name in enumerate("abc"):
        kept_arrays("things", name, make, tmp_path)
        os.utime(tmp_path / f"{name}.npz", (1000 + age, 1000 + age))
    kept_arrays("things", "a", make, tmp_path)
    kept_arrays("things", "d", make, tmp_path)
    assert sorted(file.stem for file in tmp_path.iterdir()) == ["a", "c", "d"]


def test_other_code_is_another_hash(tmp_path):
    folder, file = tmp_path / "package", tmp_path / "module.py"
    folder.mkdir()
    (folder / "one.py").write_text("a = 1")
    file.write_text("b = 2")
    before = code_hash(folder, file)
    assert code_hash(folder, file) == before != code_hash(folder)
    (folder / "one.py").write_text("a = 2")
    assert code_hash(folder, file) != before


def test_the_users_cache_is_where_it_is_told_to_be(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache("masks") == tmp_path / "lfportrait" / "masks"
