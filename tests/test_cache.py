"""Hashes of what things are made of, and what is kept under them."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from lfportrait import cache
from lfportrait.cache import kept_arrays, tried, user_cache


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
    monkeypatch.setattr(cache, "MOST", 3)
    for age, name in enumerate("abc"):
        kept_arrays("things", name, make, tmp_path)
        os.utime(tmp_path / f"{name}.npz", (1000 + age, 1000 + age))
    kept_arrays("things", "a", make, tmp_path)
    kept_arrays("things", "d", make, tmp_path)
    assert sorted(file.stem for file in tmp_path.iterdir()) == ["a", "c", "d"]


@pytest.fixture
def other(tmp_path, monkeypatch):
    """A package beside ours."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "a_package_beside"
    (folder / "inner").mkdir(parents=True)
    (folder / "__init__.py").write_text("import json\n")
    (folder / "inner" / "shader.wgsl").write_text("let a = 1;\n")
    yield folder
    sys.modules.pop(folder.name, None)
    cache.code_of.cache_clear()


def key_of(folder):
    cache.code_of.cache_clear()
    return cache.key_of(f"{folder.name}.inner", 1)


@pytest.mark.parametrize("file", ["__init__.py", "inner/shader.wgsl", "inner/new.py"])
def test_a_change_of_a_package_changes_the_keys_of_what_it_makes(other, file):
    before, ours = key_of(other), cache.key_of("lfportrait.field", 1)
    (other / file).write_text("other = 1\n")
    assert key_of(other) != before and cache.key_of("lfportrait.field", 1) == ours


def test_what_is_compiled_is_no_part_of_a_key(other):
    before = key_of(other)
    (other / "__pycache__").mkdir()
    (other / "__pycache__" / "one.cpython-311.pyc").write_bytes(b"code")
    for name in ("one.nbi", "one.nbc", "warm-1", ".hidden"):
        (other / name).write_bytes(b"code")
    assert key_of(other) == before


def test_where_a_package_lies_is_no_part_of_a_key(other, tmp_path, monkeypatch):
    """The machines of a batch may have it in different folders."""
    before = key_of(other)
    (tmp_path / "elsewhere").mkdir()
    other.rename(tmp_path / "elsewhere" / other.name)
    monkeypatch.syspath_prepend(tmp_path / "elsewhere")
    assert key_of(other) == before


def test_files_are_read_once(other, monkeypatch):
    before = key_of(other)
    monkeypatch.setattr(Path, "read_bytes", None)
    assert key_of(other) == before
    monkeypatch.undo()


def test_a_damaged_hash_is_made_again(other):
    before = key_of(other)
    for file in user_cache("code").iterdir():
        file.write_text("half")
    assert key_of(other) == before


def test_keys_differ_by_maker_and_by_package():
    keys = [cache.key_of(name, 1) for name in (
        "lfportrait.field", "lfportrait.example", "lfportrait_eval.tables.run")]
    assert len({*keys}) == 3
    assert cache.code_of("lfportrait") != cache.code_of("lfportrait_eval")
    with pytest.raises(KeyError):
        cache.key_of("no_such_package.module", 1)


def test_the_users_cache_is_where_it_is_told_to_be(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache("masks") == tmp_path / "lfportrait" / "masks"


def test_what_is_only_tried_goes_with_the_next_try_unless_it_was_kept(tmp_path):
    def ask(key):
        kept_arrays("tries", key, lambda: {"x": np.zeros(2)}, tmp_path)

    def there():
        return {path.stem for path in tmp_path.glob("*.npz")}

    ask("always")
    with tried():
        ask("always")
        ask("first")
        ask("both")
    assert there() == {"always", "first", "both"}, "it may be saved: then it is read again"
    with tried():
        ask("both")
        ask("second")
    assert there() == {"always", "both", "second"}
    ask("second")  # it was saved
    for number in range(5):
        with tried():
            ask(f"another {number}")
    assert there() == {"always", "second", "another 4"}
