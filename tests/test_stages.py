"""A job's stages: done once, done again when an input changes, and never half done."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from lfportrait.cache import StageFolder, fingerprint_files, hash_of
from lfportrait.errors import UserError
from lfportrait.files import atomic_path, atomic_write, write_exr, write_image
from lfportrait.media.pictures import read_image


@dataclass
class Config:
    number: int = 1
    name: str = "a"


def counted(folder: Path, calls: list[str], name: str):
    def write() -> dict:
        calls.append(name)
        (folder / f"{name}.txt").write_text(name)
        return {"value": np.float32(2.5)}
    return write


def test_a_finished_stage_is_not_done_again(tmp_path):
    calls: list[str] = []
    for _ in range(2):
        stages = StageFolder(tmp_path)
        figures = stages.run("one", "key", ["one.txt"], counted(tmp_path, calls, "one"))
        assert figures["value"] == 2.5
    assert calls == ["one"]
    assert stages.resumed == ["one"]


@pytest.mark.parametrize("spoil", ["key", "output", "record", "torn record"])
def test_a_stage_is_done_again_when_anything_it_rests_on_is_gone(tmp_path, spoil):
    calls: list[str] = []
    StageFolder(tmp_path).run("one", "key", ["one.txt"], counted(tmp_path, calls, "one"))
    if spoil == "output":
        (tmp_path / "one.txt").unlink()
    elif spoil == "record":
        (tmp_path / ".stages" / "one.json").unlink()
    elif spoil == "torn record":
        (tmp_path / ".stages" / "one.json").write_text('{"key": "ke')
    key = "other" if spoil == "key" else "key"
    StageFolder(tmp_path).run("one", key, ["one.txt"], counted(tmp_path, calls, "one"))
    assert calls == ["one", "one"]


def test_a_stage_that_fails_leaves_no_record(tmp_path):
    calls: list[str] = []
    StageFolder(tmp_path).run("one", "key", ["one.txt"], counted(tmp_path, calls, "one"))

    def fail() -> dict:
        raise RuntimeError("in the middle")

    with pytest.raises(RuntimeError):
        StageFolder(tmp_path).run("one", "new key", ["one.txt"], fail)
    StageFolder(tmp_path).run("one", "key", ["one.txt"], counted(tmp_path, calls, "one"))
    assert calls == ["one", "one"]


def test_keys_tell_every_parameter_apart():
    keys = {hash_of(Config()), hash_of(Config(number=2)), hash_of(Config(name="b")),
            hash_of(Config(), np.arange(3)), hash_of(Config(), np.arange(4)), hash_of({"a": 1})}
    assert len(keys) == 6
    assert hash_of(Config()) == hash_of(Config())


def test_fingerprint_sees_contents_and_names(tmp_path):
    (tmp_path / "a").write_text("1")
    first = fingerprint_files([tmp_path / "a"])
    (tmp_path / "a").write_text("2")
    assert fingerprint_files([tmp_path / "a"]) != first
    (tmp_path / "a").rename(tmp_path / "b")
    (tmp_path / "b").write_text("1")
    assert fingerprint_files([tmp_path / "b"]) != first
    with pytest.raises(UserError, match="can't read"):
        fingerprint_files([tmp_path / "missing"])


def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "file.txt"
    target.write_text("old")
    with pytest.raises(KeyboardInterrupt), atomic_write(target) as stream:
        stream.write(b"half")
        raise KeyboardInterrupt
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]
    with atomic_path(target) as temporary:
        assert temporary.suffix == ".txt"
        temporary.write_text("new")
    assert target.read_text() == "new"


def test_tasks_may_begin_in_one_folder_at_the_same_moment(tmp_path):
    folder = tmp_path / "job"
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda _: [StageFolder(folder) for _ in range(100)], range(8)))
    assert [path.name for path in folder.rglob("*")] == [".stages"]


def test_unwritable_places_are_the_users_mistake(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(UserError, match="can't write"), atomic_write(tmp_path / "file" / "deep"):
        pass
    with pytest.raises(UserError, match="can't write"):
        StageFolder(tmp_path / "file")


@pytest.mark.parametrize("channels", [3, 4])
def test_pictures_survive_the_disk(tmp_path, channels):
    image = np.random.default_rng(0).integers(0, 256, (7, 5, channels), dtype=np.uint8)
    write_image(tmp_path / "a.png", image)
    assert np.array_equal(read_image(tmp_path / "a.png"), image)
    write_image(tmp_path / "b.png", image / 255.0)
    assert np.array_equal(read_image(tmp_path / "b.png"), image)


def test_bad_pictures_are_told_in_one_line(tmp_path):
    (tmp_path / "a.png").write_bytes(b"not a picture")
    for name, text in (("a.png", "can't read the picture"), ("b.png", "no such file")):
        with pytest.raises(UserError, match=text):
            read_image(tmp_path / name)
    with pytest.raises(UserError, match="unknown picture format"):
        write_image(tmp_path / "a.xyz", np.zeros((2, 2, 3)))


def test_depth_is_written_as_openexr(tmp_path):
    depth = np.random.default_rng(0).random((5, 7)).astype(np.float32)
    depth[0, 0] = np.inf
    write_exr(tmp_path / "d.exr", depth)
    data = (tmp_path / "d.exr").read_bytes()
    assert data[:4] == bytes([0x76, 0x2F, 0x31, 0x01])
    # The last row of an uncompressed file is its last 4 W bytes, behind its number and its size.
    assert np.array_equal(np.frombuffer(data[-28:], "<f4"), depth[-1])
    assert np.array_equal(np.frombuffer(data[-36:-28], "<i4"), [4, 28])
