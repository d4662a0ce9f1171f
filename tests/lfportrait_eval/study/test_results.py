"""From answer files to figures, and what is done with files that can't be used."""

import csv
import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from lfportrait.cli import main
from lfportrait_eval.study import Answers, Question, Trial, analyse, read_answers, write_results
from tests.lfportrait_eval.study.people import answer, by_strength, write_answers

STRENGTH = {"skin": 1.2, "paper": 0.0, "arf": -1.2}


@pytest.fixture(scope="module")
def files(design, tmp_path_factory):
    generator = np.random.default_rng(1)
    return write_answers(tmp_path_factory.mktemp("people") / "answers", design, 50,
                         by_strength(STRENGTH, generator))


@pytest.fixture(scope="module")
def figures(files, study, tmp_path_factory):
    out = tmp_path_factory.mktemp("results") / "out"
    return write_results(files, out, study=study), out


def test_preferences_of_made_up_people_are_found(figures):
    found, _ = figures
    assert found["people"] == 50 and len(found["preferences"]) == 9
    assert found["answers"] == 50 * 13 * 3
    for row in found["preferences"]:
        chance = 1 / (1 + np.exp(STRENGTH[row["second"]] - STRENGTH[row["first"]]))
        assert chance > 0.5 and row["total"] == 200
        assert row["share"] == pytest.approx(chance, abs=0.11)
        assert row["low"] < row["share"] < row["high"]
        assert row["people_for"] + row["people_against"] + row["people_undecided"] == 50
        assert row["p"] <= row["p_holm"] < 0.01
    for ranking in found["ranking"].values():
        assert [row["method"] for row in ranking] == ["skin", "paper", "arf"]
        assert ranking[0]["low"] > ranking[1]["high"]
    assert all(0 < row["kendall_u"] < 0.6 for row in found["agreement"])
    assert all(abs(row["share"] - 0.5) < 0.1 for row in found["left"])
    assert found["not_compared"] == [] and found["seconds_per_answer"] == 2


def test_files_to_read_and_to_compute_with(figures):
    found, out = figures
    text = (out / "results.md").read_text()
    row = found["preferences"][0]
    assert f"| style | {row['first']} | {row['second']} | {100 * row['share']:.1f} % |" in text
    assert "left out" not in text
    with open(out / "preferences.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(each["share"]) for each in rows] == [
        each["share"] for each in found["preferences"]]
    with open(out / "ranking.csv", newline="") as stream:
        assert [each["method"] for each in csv.DictReader(stream)][:3] == ["skin", "paper", "arf"]
    assert json.loads((out / "results.json").read_text())["people"] == 50
    for name, dots in (("preferences.svg", 9), ("ranking.svg", 9)):
        root = ElementTree.fromstring((out / name).read_text())
        assert sum(each.tag.endswith("circle") for each in root.iter()) == dots
        words = [each.text for each in root.iter() if each.tag.endswith("text")]
        assert any("skin" in word for word in words)


def test_drawn_intervals_are_where_the_axis_says(figures):
    found, out = figures
    root = ElementTree.fromstring((out / "preferences.svg").read_text())
    ticks = {each.text: float(each.get("x")) for each in root.iter()
             if each.get("text-anchor") == "middle"}
    scale = (ticks["100"] - ticks["0"]) / 100
    dots = [float(each.get("cx")) for each in root.iter() if each.tag.endswith("circle")]
    assert [(dot - ticks["0"]) / scale for dot in dots] == pytest.approx(
        [100 * row["share"] for row in found["preferences"]], abs=0.05)


def trial(pair, left, right, choice, repeat=False):
    return Trial(pair, "anna", "ink", left, right, repeat, {"style": choice}, {})


def person(name, *trials):
    return Answers(None, "s", name, (Question("style", "?"),), trials)


def test_repeats_count_for_self_agreement_alone():
    people = [person("1", trial(0, "a", "b", "left"), trial(0, "b", "a", "right", True)),
              person("2", trial(0, "b", "a", "right"), trial(0, "a", "b", "right", True))]
    found = analyse(people)
    assert found["preferences"][0]["total"] == 2 and found["preferences"][0]["share"] == 1
    assert (found["self_agreement"][0]["count"], found["self_agreement"][0]["total"]) == (1, 2)
    assert found["agreement"][0]["kendall_u"] == 1 and found["agreement"][0]["fleiss_kappa"] is None
    assert found["left"][0]["count"] == 1 and found["seconds_per_answer"] is None


def test_a_person_counts_once_in_the_test():
    many = [trial(place, "a", "b", "left") for place in range(8)]
    found = analyse([person("1", *many), person("2", trial(0, "a", "b", "right")),
                     person("3", trial(0, "a", "b", "left"), trial(1, "a", "b", "right"))])
    row = found["preferences"][0]
    assert (row["people_for"], row["people_against"], row["people_undecided"]) == (1, 1, 1)
    assert row["p"] == 1 and row["share"] == 9 / 11


def test_methods_that_never_met_have_no_ranking(tmp_path, design):
    found = analyse([person("1", trial(0, "a", "b", "left"), trial(1, "c", "d", "left"))])
    assert found["ranking"] == {"style": None} and len(found["not_compared"]) == 4
    assert found["self_agreement"][0]["share"] is None


def spoil(design, number, what):
    data = answer(design, number, lambda *_: "left")
    what(data)
    return json.dumps(data)


def test_each_file_that_cannot_be_used_is_told(design, study, tmp_path, capsys):
    folder = tmp_path / "answers"
    files = write_answers(folder, design, 2, lambda *_: "left")
    texts = {
        "torn": ('{"format": "lfp', "not valid JSON"),
        "other": ("[1]", "holds no answers"),
        "study": (spoil(design, 5, lambda data: data.update(study="xyz")), "another study, xyz"),
        "gap": (spoil(design, 6, lambda data: data["trials"][2]["choices"].pop("quality")),
                "pair 3 has no answer to quality"),
        "short": (spoil(design, 7, lambda data: data["trials"].pop()), "12 pairs instead of 13"),
        "pair": (spoil(design, 8, lambda data: data["trials"][0].update(left="x")),
                 "pair 1 is not one of the study"),
        "twice": (files[0].read_text(), "000.json already"),
        "asked": (spoil(design, 9, lambda data: data["questions"].pop()), "other questions"),
    }
    for name, (text, _) in texts.items():
        (folder / f"{name}.json").write_text(text)
    (folder / "bytes.json").write_bytes(b"\xff\xfe\x00")
    every = sorted(map(str, folder.glob("*.json")))
    assert main(["study", "results", *every, str(folder / "none.json"), "--study", str(study),
                 "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().err.splitlines()
    assert len(told) == len(texts) + 2
    for name, (_, why) in texts.items():
        assert any(f"{name}.json" in line and why in line for line in told), name
    assert json.loads((tmp_path / "out" / "results.json").read_text())["people"] == 2
    assert "Files that were left out" in (tmp_path / "out" / "results.md").read_text()
    bad = [str(folder / f"{name}.json") for name in texts if name != "twice"]
    assert main(["study", "results", *bad, "--study", str(study), "--out",
                 str(tmp_path / "none")]) == 2
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1 and "no answers can be used" in error
    assert not (tmp_path / "none").exists()


def test_without_the_design_the_study_of_most_files_counts(design, tmp_path):
    files = write_answers(tmp_path / "answers", design, 3, lambda *_: "left")
    files[0].write_text(spoil(design, 0, lambda data: data.update(study="xyz")))
    people, left_out = read_answers(files)
    assert [each.person for each in people] == ["1", "2"]
    assert left_out[0][0] == files[0]


@pytest.mark.parametrize("words, told", [
    ([], "name the files"), (["--study", "nowhere"], "nowhere"),
    (["--study", "{}/results.json"], "is not the study.json")])
def test_mistakes_are_told_in_one_line(figures, capsys, words, told):
    _, out = figures
    assert main(["study", "results", *(word.format(out) for word in words)]) == 2
    error = capsys.readouterr().err.strip()
    assert told in error and len(error.splitlines()) == 1
