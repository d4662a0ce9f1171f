"""The command that tells what works: aligned lines, the same facts as JSON."""

import json
import re

from lfportrait.cli import main
from lfportrait.cli.doctor import _lines
from lfportrait.health import Fact

FACTS = [Fact("machine", "memory", "8 GB free"), Fact("machine", "a long name", "two"),
         Fact("networks", "one", "missing: for faces", "bad", "get one"),
         Fact("networks", "other", "missing: few", "optional", "get other")]


def test_columns_are_aligned():
    assert _lines(FACTS, colored=False, unicode=False) == [
        "machine", "  + memory       8 GB free", "  + a long name  two", "", "networks",
        "  ! one          missing: for faces  get one",
        "  - other        missing: few        get other"]


def test_colors_do_not_move_columns():
    plain = _lines(FACTS, colored=False, unicode=True)
    dyed = _lines(FACTS, colored=True, unicode=True)
    assert [re.sub("\033\\[[0-9;]*m", "", line) for line in dyed] == plain
    assert plain != dyed


def test_it_tells_the_facts_and_writes_them(tmp_path, capsys):
    assert main(["doctor", "--json", str(tmp_path / "facts.json")]) == 0
    text = capsys.readouterr().out
    figures = json.loads((tmp_path / "facts.json").read_text())
    assert {"version", "device", "seconds"} <= set(figures)
    for fact in figures["facts"]:
        line = next(line for line in text.splitlines()
                    if fact["name"] in line and fact["text"] in line)
        assert fact["remedy"] in line
    bad = [fact for fact in figures["facts"] if fact["state"] == "bad"]
    assert figures["problems"] == len(bad)
    assert ("No problems found." in text) == (not bad)


def test_quiet_says_nothing(capsys):
    assert main(["doctor", "--quiet"]) == 0
    assert capsys.readouterr().out == ""
