"""Temporary folders that are too small, full or not to be written to are told in one line."""

import errno
import os
import tempfile
from types import SimpleNamespace

import pytest

from lfportrait import temporary
from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.files import write_json
from lfportrait.temporary import temporary_folder


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


@pytest.fixture
def free(monkeypatch):
    """Sets how many bytes seem to be free."""
    def set_to(count):
        monkeypatch.setattr(temporary.shutil, "disk_usage", lambda _: SimpleNamespace(free=count))
    return set_to


def test_it_is_private_and_gone_afterwards(place):
    with temporary_folder() as folder:
        (folder / "a").write_text("a")
        assert folder.parent == place
        if os.name == "posix":
            assert folder.stat().st_mode & 0o077 == 0
    assert list(place.iterdir()) == []


def test_too_small_a_place_is_told_before_the_work(place, free):
    free(1 << 20)
    said = r"TMPDIR.* 1\.0 MB free and 8\.4 MB are needed"
    with pytest.raises(UserError, match=said), temporary_folder(8 << 20):
        pytest.fail("the block must not begin")
    assert list(place.iterdir()) == []


@pytest.mark.parametrize("error", [
    RuntimeError("[database_sqlite.cc:1350] SQLite error: database or disk is full"),
    RuntimeError("[x.cc:1] SQLite error: disk I/O error"),
    RuntimeError("unable to open database file")])
def test_what_a_library_says_of_a_full_place_becomes_a_line(place, error):
    said = rf"{place} \(TMPDIR\) is full .*set TMPDIR"
    with pytest.raises(UserError, match=said) as told, temporary_folder():
        raise error
    assert "database_sqlite.cc" not in str(told.value)
    assert list(place.iterdir()) == []


def test_a_file_that_finds_no_room_becomes_a_line(free):
    with pytest.raises(UserError, match=r"TMPDIR.*No space left"), temporary_folder() as folder:
        raise OSError(errno.ENOSPC, "No space left on device", str(folder / "a.db"))
    with pytest.raises(UserError, match="TMPDIR"), temporary_folder():
        free(0)
        raise OSError(errno.ENOSPC, "No space left on device")


def test_our_own_line_about_a_file_in_it_names_the_place_too(monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(UserError, match="TMPDIR") as told, temporary_folder() as folder:
        monkeypatch.setattr("lfportrait.files.os.open", full)
        write_json(folder / "a.json", {})
    assert "--out" not in str(told.value)


@pytest.mark.parametrize("error", [
    RuntimeError("no matches"), ValueError("disk"), KeyError("a"), UserError("too few photos"),
    OSError(errno.ENOSPC, "No space left on device", "/elsewhere/a.npz"),
    FileNotFoundError(errno.ENOENT, "No such file", "a")])
def test_other_errors_are_left_alone(error):
    with pytest.raises(type(error)) as told, temporary_folder():
        raise error
    assert told.value is error


def test_a_place_that_can_not_be_written_to_is_told(place, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(place / "missing"))
    with pytest.raises(UserError, match=r"missing \(TMPDIR\)"), temporary_folder():
        pytest.fail("the block must not begin")

    def none():
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found")

    monkeypatch.setattr(tempfile, "gettempdir", none)
    with pytest.raises(UserError, match="set TMPDIR"), temporary_folder():
        pytest.fail("the block must not begin")


def test_a_full_disk_anywhere_is_one_line_of_the_command(monkeypatch, capsys):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device", "/small/kernel.nbi")

    monkeypatch.setattr("lfportrait.cli.dispatch._execute", full)
    assert main(["doctor"]) == 2
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1 and "/small/kernel.nbi" in told and "TMPDIR" in told
