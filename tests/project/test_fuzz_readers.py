"""The script that damages inputs runs, says the same for the same seed, and sees what is wrong."""

from pathlib import Path

import pytest

import fuzz_readers
from lfportrait.errors import UserError
from tests import inputs


def rows(text):
    return [line for line in text.splitlines() if line.startswith("| ")]


@pytest.mark.slow  # tests/test_mutations.py damages inputs of all kinds, too
def test_every_reader_takes_damaged_inputs(tmp_path, capfd):
    count = len(inputs.KINDS)
    assert fuzz_readers.main(["--seed", "2", "--count", str(count)]) == 0
    table = rows(capfd.readouterr().out)
    assert table[2:-1] == [f"| {name} | 1 | 0 |" for name in inputs.KINDS]
    assert table[-1] == f"| all | {count} | 0 |"


def test_damage_is_decided_by_the_seed_and_the_number(tmp_path):
    good = tmp_path / "good" / "landmarks"
    good.mkdir(parents=True)
    inputs.KINDS["landmarks"].write(good)
    told = []
    for number in (3, 3, 4):
        place, done = fuzz_readers._damaged(tmp_path, "landmarks", 1, number)
        told.append((done, [path.read_bytes() for path in place.rglob("*") if path.is_file()]))
    assert told[0] == told[1] != told[2]


def fails(folder: Path) -> None:
    raise KeyError("x")


def empty(folder: Path) -> None:
    raise UserError("")


def endless(folder: Path) -> None:
    error = UserError("x")
    error.args = ("x" * 9999,)
    raise error


def told(folder: Path) -> None:
    raise UserError("this is no picture")


def greedy(folder: Path) -> None:
    bytearray(b"x") * 2 ** 28


@pytest.mark.parametrize(("read", "finding"), [
    (fails, "KeyError"), (empty, "not one line"), (endless, "9999 letters"), (greedy, "took"),
    (told, "")])
def test_what_is_neither_a_result_nor_one_line_is_found(tmp_path, monkeypatch, read, finding):
    if read is greedy and not fuzz_readers._peak_memory(reset=True):
        pytest.skip("this system doesn't tell how much memory a process had")
    monkeypatch.setattr(fuzz_readers, "MEMORY", 2 ** 26)
    monkeypatch.setitem(inputs.KINDS, "strange", inputs.Kind(lambda folder: None, (read,)))
    found = fuzz_readers._finding("strange", tmp_path)
    assert found.startswith(finding) if finding == "KeyError" else finding in found
    assert bool(found) == bool(finding)


def test_findings_are_told_with_what_repeats_them(capsys):
    assert fuzz_readers._report([(7, "PNG", "a.png cut", "KeyError"), (8, "GIF", "", "")], 3) == 1
    out = capsys.readouterr().out
    assert "--seed 3 --input 7" in out and "| all | 2 | 1 |" in out
