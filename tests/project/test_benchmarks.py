"""Documents with measured figures say what the file of figures says."""

import copy

import pytest

import make_benchmarks
from lfportrait_eval.bench import read_measured

KNOWN = read_measured(make_benchmarks.FIGURES)
DOCUMENTS = make_benchmarks.documents(KNOWN)


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_a_document_is_up_to_date(path):
    assert path.read_text("utf-8") == DOCUMENTS[path], "run scripts/make_benchmarks.py"


def test_each_figure_has_its_run_and_each_run_its_conditions():
    assert {run for _, run in KNOWN["figures"].values()} == set(KNOWN["runs"])
    for run in KNOWN["runs"].values():
        assert run["machine"]["processor"] and run["machine"]["cores"] > 0
        assert run["vectors"] and run["commit"] and run["date"] and run["command"]


def test_all_figures_that_are_shown_are_known():
    fields = {match.group(1) for table in make_benchmarks.TABLES.values() for row in table.rows
              for cell in row for match in make_benchmarks.FIELD.finditer(cell)}
    assert len(fields) > 60 and fields <= set(KNOWN["figures"])


def test_another_figure_gives_other_documents():
    changed = copy.deepcopy(KNOWN)
    run = changed["figures"]["encode.4k.seconds"][1]
    changed["figures"]["encode.4k.seconds"] = [7.25, run]
    changed["runs"][run]["date"] = "2031-01-05"
    texts = {path.name: text for path, text in make_benchmarks.documents(changed).items()}
    for name in ("README.md", "benchmarks.md"):
        line = next(line for line in texts[name].splitlines() if line.startswith("| coding 4K"))
        assert "| 7.2 s |" in line and "2031-01-05" in line
    assert texts["coding.md"] == DOCUMENTS[make_benchmarks.ROOT / "docs" / "coding.md"]


@pytest.mark.parametrize(("seconds", "text"), [
    (0.038, "0.038 s"), (0.2, "0.20 s"), (3, "3 s"), (18.4, "18 s"), (60.0, "1 min"),
    (92.2, "1 min 32 s")])
def test_durations(seconds, text):
    assert make_benchmarks.duration(seconds) == text
