"""The file of measured figures: what is added, replaced and dropped."""

import datetime
import json

import pytest

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait_eval.bench import read_measured, record
from lfportrait_eval.bench.run import commit_of_checkout, flat_figures

MACHINE = {"processor": "abacus", "cores": 2}
DAY = datetime.date(2026, 11, 27)


def test_numbers_get_dotted_names():
    figures = {"encode": {"4k": {"seconds": 0.5, "method": "slices", "mask": [{"bytes": 3}]}},
               "machine": MACHINE, "peak_memory_bytes": 7, "right": True}
    assert flat_figures(figures) == {"encode.4k.seconds": 0.5, "peak_memory_bytes": 7}


def test_a_run_replaces_its_figures_and_drops_runs_that_are_no_longer_needed(tmp_path):
    path = tmp_path / "measured.json"
    record(path, "encode", {"4k": {"seconds": 0.5}, "8k": {"seconds": 2}, "machine": MACHINE},
           "lfportrait bench encode", date=DAY, commit="aaaaaaa")
    record(path, "all", {"encode": {"4k": {"seconds": 0.4}}, "machine": MACHINE,
                         "vectors": {"unit": "AVX2", "lanes": 16}},
           "lfportrait bench all", date=DAY, commit="bbbbbbb")
    known = read_measured(path)
    assert known["figures"] == {
        "encode.4k.seconds": [0.4, "2026-11-27 all bbbbbbb"],
        "encode.8k.seconds": [2, "2026-11-27 encode aaaaaaa"]}
    assert known["runs"]["2026-11-27 all bbbbbbb"] == {
        "command": "lfportrait bench all", "machine": MACHINE, "vectors": "AVX2",
        "commit": "bbbbbbb", "date": "2026-11-27"}
    record(path, "encode", {"8k": {"seconds": 1}, "machine": MACHINE}, "", date=DAY, commit="c")
    assert list(read_measured(path)["runs"]) == ["2026-11-27 all bbbbbbb", "2026-11-27 encode c"]


def test_a_commit_or_a_version_is_told():
    assert 1 < len(commit_of_checkout()) < 16


def test_another_file_is_refused_before_anything_is_measured(tmp_path, capsys):
    path = tmp_path / "figures.json"
    path.write_text(json.dumps({"4k": {}}))
    with pytest.raises(UserError, match="no file of measured figures"):
        read_measured(path)
    assert main(["bench", "all", "--quiet", "--record", str(path)]) == 2
    assert "no file of measured figures" in capsys.readouterr().err
    assert json.loads(path.read_text()) == {"4k": {}}
