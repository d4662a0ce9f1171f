"""What a killed process leaves is removed; what is being written and a person's files are not."""

import os
import signal
import subprocess
import sys
import time

import pytest

from lfportrait import temporary
from lfportrait.errors import UserError
from lfportrait.files import atomic_path, fresh_folder, write_json
from lfportrait.temporary import moved_name, part_name, sweep, sweep_below

WRITES = """
import sys, time
from pathlib import Path
from lfportrait.files import atomic_path, fresh_folder
from lfportrait.temporary import temporary_folder
with {block} as temporary:
    (temporary / "half" if temporary.is_dir() else temporary).write_bytes(b"half")
    print(temporary, flush=True)
    time.sleep(60)
"""
BLOCKS = ["atomic_path(Path(sys.argv[1]) / 'field.npz')",
          "fresh_folder(Path(sys.argv[1]) / 'capture')",
          "temporary_folder()"]


@pytest.fixture
def writer(tmp_path):
    """Starts a process that is in the middle of writing; gives it and the temporary path."""
    begun = []

    def start(block, place=tmp_path):
        process = subprocess.Popen([sys.executable, "-c", WRITES.format(block=block), str(place)],
                                   stdout=subprocess.PIPE, text=True,
                                   env={**os.environ, "TMPDIR": str(tmp_path)})
        begun.append(process)
        return process, type(tmp_path)(process.stdout.readline().strip())

    yield start
    for process in begun:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("block", BLOCKS)
def test_a_killed_process_leaves_nothing_once_the_next_one_comes(writer, tmp_path, block):
    process, temporary = writer(block)
    assert temporary.exists() and sweep(tmp_path) == []
    assert temporary.exists()  # it lives
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert temporary.exists()
    assert sweep(tmp_path) == [temporary.name]
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_ended_and_was_not_asked_for_its_end_is_gone(writer, tmp_path):
    process, temporary = writer(BLOCKS[0])
    os.kill(process.pid, signal.SIGKILL)
    end = time.monotonic() + 20
    while not sweep(tmp_path) and time.monotonic() < end:
        time.sleep(0.05)
    assert not temporary.exists()


def test_whoever_writes_to_a_folder_first_sweeps_it(writer, tmp_path):
    process, _ = writer(BLOCKS[0])
    process.kill()
    process.wait()
    write_json(tmp_path / "other.json", {})
    assert [path.name for path in tmp_path.iterdir()] == ["other.json"]


def test_a_later_process_of_the_same_number_is_another(tmp_path):
    mine = part_name(tmp_path / "a.npz")
    number, start, rest = mine.name.removeprefix(".a.").split("-", 2)
    if start == "0":
        pytest.skip("this system does not say when a process started")
    other = tmp_path / f".a.{number}-{int(start) + 1}-{rest}"
    for path in (mine, other):
        path.write_bytes(b"half")
    assert sweep(tmp_path) == [other.name] and mine.exists()


@pytest.mark.parametrize("folder", [False, True])
def test_what_another_host_writes_stays_for_a_day(tmp_path, monkeypatch, folder):
    with monkeypatch.context() as there:
        there.setattr(temporary, "_host", lambda: "0123abcd")
        path = part_name(tmp_path / "a.npz")
    inside = path / "half" if folder else path
    inside.parent.mkdir(exist_ok=True)
    inside.write_bytes(b"half")
    yesterday = time.time() - 25 * 3600
    assert sweep(tmp_path) == []
    if folder:
        os.utime(path, (yesterday, yesterday))
        assert sweep(tmp_path) == []  # something in it is new
    os.utime(inside, (yesterday, yesterday))
    os.utime(path, (yesterday, yesterday))
    assert sweep(tmp_path) == [path.name]


@pytest.mark.parametrize("name", [
    ".reconstruct.abcd1234.npz", ".field.part.npz", "photo.123-4-5.part", ".a.1-2-3-4.part.png",
    ".field.checkpoint.npz", "holiday.part", "11-2-01234567.part"])
def test_names_that_only_look_alike_are_a_persons(tmp_path, name):
    (tmp_path / name).write_bytes(b"mine")
    os.utime(tmp_path / name, (1e9, 1e9))
    assert sweep(tmp_path) == [] and (tmp_path / name).exists()


def test_a_link_is_removed_and_not_what_it_leads_to(tmp_path, dead):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "photo.jpg").write_bytes(b"mine")
    dead(tmp_path / "a").symlink_to(tmp_path / "mine", target_is_directory=True)
    sweep(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    assert (tmp_path / "mine" / "photo.jpg").exists()


@pytest.fixture
def dead(monkeypatch):
    """Temporary names of a process that is gone."""
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()

    def name(path):
        with monkeypatch.context() as there:
            there.setattr(os, "getpid", lambda: child.pid)
            return part_name(path)

    return name


def test_an_older_file_that_was_moved_away_goes_back(tmp_path, dead):
    moved_name(dead(tmp_path / "capture")).mkdir()
    moved_name(dead(tmp_path / "field.npz")).write_bytes(b"older")
    (tmp_path / "styled.npz").write_bytes(b"newer")
    moved_name(dead(tmp_path / "styled.npz")).write_bytes(b"older")
    sweep(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["capture", "field.npz",
                                                                "styled.npz"]
    assert (tmp_path / "field.npz").read_bytes() == b"older"
    assert (tmp_path / "styled.npz").read_bytes() == b"newer"


def test_folders_in_folders(tmp_path, dead):
    place = tmp_path / "anna" / ".stages"
    place.mkdir(parents=True)
    dead(place / "reconstruct.npz").write_bytes(b"half")
    sweep_below(tmp_path)
    assert list(place.iterdir()) == []


def test_a_batch_and_a_studio_sweep_what_they_take(tmp_path, dead):
    from lfportrait.job.batch.journal import locked
    from lfportrait.studio.projects import Projects

    for place, begin in ((tmp_path / "batch", locked), (tmp_path / "studio", Projects)):
        (place / "anna").mkdir(parents=True)
        half = dead(place / "anna" / "field.npz")
        half.write_bytes(b"half")
        begun = begin(place)
        if begin is locked:
            with begun:
                assert not half.exists()
        else:
            assert not half.exists()
            begun.close()


def test_a_folder_takes_an_older_ones_place_or_leaves_it(tmp_path):
    target = tmp_path / "capture"
    for text in ("older", "newer"):
        with fresh_folder(target) as folder:
            (folder / "a").write_text(text)
    with pytest.raises(ZeroDivisionError), fresh_folder(target) as folder:
        (folder / "a").write_text("half")
        raise ZeroDivisionError
    assert (target / "a").read_text() == "newer"
    assert [path.name for path in tmp_path.iterdir()] == ["capture"]


def test_long_names_have_temporary_ones_and_too_long_ones_are_told_at_once(tmp_path):
    with atomic_path(tmp_path / f"{'ä' * 125}.json") as temporary:
        temporary.write_text("{}")
    assert [path.name for path in tmp_path.iterdir()] == [f"{'ä' * 125}.json"]
    with pytest.raises(UserError, match="too long"), atomic_path(tmp_path / f"{'a' * 260}.json"):
        pytest.fail("the block must not begin")


def test_kernels_half_written_are_removed(tmp_path, monkeypatch):
    from lfportrait.simd import host

    monkeypatch.setattr(host, "_cache_folder", lambda home: tmp_path)
    names = ("k-1.py311.nbi", "k-1.py311.nbi.tmp.0123456789abcdef", "k-1.py311.1.nbc.tmp.0123")
    for name in names:
        (tmp_path / name).write_bytes(b"")
    for name in names[:2]:
        os.utime(tmp_path / name, (1e9, 1e9))
    host.sweep_kernels()
    assert sorted(path.name for path in tmp_path.iterdir()) == [names[2], names[0]]
