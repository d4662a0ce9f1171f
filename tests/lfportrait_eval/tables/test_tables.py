"""The tables from end to end on a small head: what is done is kept, what is wrong is told."""

import csv
import json
import os
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from lfportrait.capture import Capture
from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.example import Exemplar
from lfportrait.plugins import offered
from lfportrait_eval import tables
from lfportrait_eval.tables import (
    BEGIN,
    END,
    TablesConfig,
    Views,
    real_views,
    sources_of,
    write_tables,
)
from lfportrait_eval.tables import run as running

SIZES = ("pixels=40", "render-size=64", "close-size=64", "painted-size=64", "painted-views=2",
         "painted-steps=1", "crops=4")
SMALL = TablesConfig(methods=("skin", "views"), sizes=SIZES, views=9, cone=30.0, speed=False)


def styles(files: Path, *names: str) -> list[Exemplar]:
    return [Exemplar.load(files / f"{name}.png") for name in names]


def compare(files: Path, out: Path, config: TablesConfig = SMALL, names=("warm",)):
    sources = sources_of((f"ann={files / 'head.cap'}:{files / 'head.npz'}",))
    return write_tables(sources, styles(files, *names), out, config)


@pytest.fixture(scope="module", autouse=True)
def known_targets():
    """What views are measured against is made once: sitter and styles are the same in all runs."""
    known, make = {}, running.Target

    def target(sitter, exemplar, *numbers):
        key = sitter.name, exemplar.image.tobytes(), numbers
        if key not in known:
            known[key] = make(sitter, exemplar, *numbers)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(running, "Target", target)
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory, files):
    """A finished run, and its figures."""
    out = tmp_path_factory.mktemp("run") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("LFPORTRAIT_MODELS", raising=False)
        patch.setattr("lfportrait.models.cache_folder", lambda: out / "models")
        return out, compare(files, out)


@pytest.fixture(scope="module", autouse=True)
def known_figures():
    """What a painter's views come to is measured once: `Brush` paints the same ones each time."""
    known, measure = {}, running.measure

    def measured(views, target, example, *rest):
        pictures = [one.arc + one.close for one in (views, example) if one is not None]
        key = (os.environ.get("LFPORTRAIT_MODELS"), target,
               *(b"".join(one.tobytes() for one in each) for each in pictures))
        if key not in known:
            known[key] = measure(views, target, example, *rest)
        return dict(known[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(running, "measure", measured)
        yield


FACTS = {"seconds": {"once": 1.0, "view": 0.1}, "peak_memory_bytes": 2 ** 30}


@dataclass
class Brush:
    """A quick painter that tints the real views, what it painted, and where it fails."""

    painted: list[tuple[str, str]] = field(default_factory=list)
    falls: dict[str, BaseException] = field(default_factory=dict)

    def paint(self, method, sitter, exemplar, *_):
        if method in self.falls:
            raise self.falls[method]
        self.painted.append((exemplar.name, method))
        real = real_views(sitter)
        tint = 0.5 + 0.01 * len(method)
        return Views(*([np.uint8(tint * picture) for picture in pictures]
                       for pictures in (real.arc, real.close))), FACTS


@pytest.fixture
def brush(monkeypatch) -> Brush:
    """Paints instead of the methods."""
    made = Brush()
    monkeypatch.setattr(running, "paint_views", made.paint)
    return made


def test_where_nothing_is_done_that_is_told(brush, files, tmp_path):
    with pytest.raises(UserError, match="nothing of this comparison is done"):
        compare(files, tmp_path / "out", replace(SMALL, done_only=True))
    assert not brush.painted and not list((tmp_path / "out").rglob("*.npz"))


@pytest.mark.slow  # only for comparisons
def test_tables_of_what_is_done_start_nothing(brush, files, tmp_path):
    compare(files, tmp_path / "out", replace(SMALL, methods=("views",)))
    before = list(brush.painted)
    figures = compare(files, tmp_path / "out", replace(SMALL, methods=("views", "skin"),
                                                       done_only=True, speed=True))
    assert brush.painted == before and "table_1" not in figures
    assert [cell["method"] for cell in figures["cells"]] == ["views"]
    assert [(row["method"], row["reason"]) for row in figures["not_measured"]["cells"]] == [
        ("skin", "not run yet")]


@pytest.mark.slow  # only the project measures; other tests paint by `Brush`
def test_the_tables_hold_what_was_measured(finished):
    _, figures = finished
    cells = {(cell["sitter"], cell["style"], cell["method"]): cell["figures"]
             for cell in figures["cells"]}
    assert set(cells) == {("ann", "warm", "skin"), ("ann", "warm", "views")}
    ours, single = cells["ann", "warm", "skin"], cells["ann", "warm", "views"]
    # Painted once on the surface, or anew in every view: the measure must tell.
    assert ours["short_normalised"] < single["short_normalised"]
    assert 0 < ours["patches"] < 60 and ours["contrast"] > 0 and ours["sharpness"] > 0
    assert -1 <= ours["contours"] <= 1
    # The painted views are a reference for all methods but themselves.
    assert ours["psnr_example"] > 5 and "psnr_example" not in single
    floor = figures["floors"]["ann"]
    assert floor["field"]["contrast"] == pytest.approx(1, abs=0.01)
    assert floor["photos"]["long_degrees"] == pytest.approx(26, rel=0.5)
    spread = figures["summary"]["skin"]["patches"]
    assert spread == {"mean": ours["patches"], "deviation": 0.0, "count": 1}


@pytest.mark.slow  # only the project measures
def test_what_needs_weights_is_not_measured_and_told(finished):
    out, figures = finished
    waiting = figures["not_measured"]["networks"]
    assert waiting["lpips_alex"] == ["lpips-alex", "alexnet"]
    assert waiting["fid_2048"] == ["inception-2048"]
    assert not any(name.startswith(("lpips", "fid", "kid", "identity")) for cell in
                   figures["cells"] for name in cell["figures"])
    text = (out / "tables.md").read_text("utf-8")
    assert "LPIPS (alex): not measured: weights missing (lpips-alex, alexnet)." in text
    assert "FID-2048: not measured: weights missing (inception-2048)." in text


@pytest.mark.slow  # only the project measures
def test_the_files_say_the_same(finished):
    out, figures = finished
    assert json.loads((out / "tables.json").read_text()) == json.loads(json.dumps(figures))
    rows = list(csv.DictReader((out / "tables.csv").open()))
    assert [row["method"] for row in rows] == ["skin", "views", "field", "photos"]
    skin = figures["cells"][0]["figures"]
    assert float(rows[0]["patches"]) == pytest.approx(skin["patches"], rel=1e-4)
    text = (out / "tables.md").read_text("utf-8")
    assert f"{skin['patches']:.2f}" in text and "the field before style" in text
    page = (out / "index.html").read_text("utf-8")
    assert page.count("<svg") >= 5 and page.count("data:image") == 4
    assert "http" not in page.replace("http://www.w3.org/2000/svg", "")


@pytest.mark.slow  # only the project measures
def test_nothing_is_done_twice(finished, files, brush):
    out, figures = finished
    again = compare(files, out)
    assert brush.painted == []
    assert again["cells"] == json.loads(json.dumps(figures["cells"]))


@pytest.mark.slow  # only for comparisons
def test_only_what_is_new_is_painted(files, tmp_path, brush):
    compare(files, tmp_path)
    first = len(brush.painted)
    figures = compare(files, tmp_path, replace(SMALL, methods=("skin", "views", "faceblit")),
                      ("warm", "cold"))
    assert first == 2 and len(figures["cells"]) == 6
    assert sorted(brush.painted[first:]) == [
        ("cold", "faceblit"), ("cold", "skin"), ("cold", "views"), ("warm", "faceblit")]


def test_figures_come_with_their_spread(files, tmp_path, brush):
    figures = compare(files, tmp_path, names=("warm", "cold"))
    values = [cell["figures"]["patches"] for cell in figures["cells"]
              if cell["method"] == "skin"]
    spread = figures["summary"]["skin"]["patches"]
    assert spread["count"] == 2 and spread["mean"] == pytest.approx(np.mean(values))
    assert spread["deviation"] == pytest.approx(abs(values[0] - values[1]) / np.sqrt(2))
    assert f"{spread['mean']:.2f} ± {spread['deviation']:.2f}" in (
        tmp_path / "tables.md").read_text("utf-8")


@pytest.mark.slow  # only for comparisons
def test_a_methods_parameters_change_that_method_alone(files, tmp_path, brush):
    config = replace(SMALL, methods=("skin", "surface", "views"))
    compare(files, tmp_path, config)
    first = len(brush.painted)
    other = replace(config.stylize, skin=replace(config.stylize.skin, patchmatch=False))
    compare(files, tmp_path, replace(config, stylize=other))
    assert brush.painted[first:] == [("warm", "skin")]


def test_a_killed_run_goes_on(files, tmp_path, brush):
    brush.falls = {"skin": KeyboardInterrupt()}
    with pytest.raises(KeyboardInterrupt):
        compare(files, tmp_path)
    brush.falls = {}
    assert len(compare(files, tmp_path)["cells"]) == 2
    assert brush.painted == [("warm", "views"), ("warm", "skin")]


def test_a_run_killed_while_it_measures_paints_nothing_again(files, tmp_path, brush, monkeypatch):
    with monkeypatch.context() as patch:
        def killed(*_):
            raise KeyboardInterrupt

        patch.setattr(running, "measure", killed)
        with pytest.raises(KeyboardInterrupt):
            compare(files, tmp_path)
    assert len(compare(files, tmp_path)["cells"]) == 2
    assert len(brush.painted) == 2


def test_a_method_that_cannot_run_is_told_and_the_others_go_on(files, tmp_path, brush):
    brush.falls = {"paper": UserError(
        "this needs the network 'x'; get it with `lfportrait models fetch x`")}
    figures = compare(files, tmp_path, replace(SMALL, methods=("paper", "views")))
    assert [cell["method"] for cell in figures["cells"]] == ["views"]
    failure, = figures["not_measured"]["cells"]
    assert failure["method"] == "paper" and "models fetch x" in failure["reason"]
    assert "paper: not measured (ann in warm): weights missing: " in (
        tmp_path / "tables.md").read_text("utf-8")


def test_a_fault_of_ours_is_raised_when_the_rest_is_written(files, tmp_path, brush):
    brush.falls = {"skin": RuntimeError("a bug")}
    with pytest.raises(RuntimeError, match="a bug"):
        compare(files, tmp_path)
    text = (tmp_path / "tables.md").read_text("utf-8")
    assert "skin: not measured (ann in warm): internal error: RuntimeError: a bug" in text
    assert (tmp_path / "index.html").is_file()


def test_methods_of_the_stylisation_appear_by_themselves():
    fields = [name for name, entry in tables.METHODS.items() if entry.kind == "field"]
    assert fields[:3] == ["skin", "paper", "surface"]
    assert set(fields[3:]) == set(offered("lfportrait.field_methods")) != set()


def run(*words) -> int:
    return main([*map(str, words), "--quiet"])


@pytest.mark.slow  # only the project measures
def test_the_command_fills_a_document(finished, files, capsys, tmp_path):
    out, _ = finished
    document = tmp_path / "comparisons.md"
    document.write_text(f"# Ours\n\n{BEGIN}\noutdated\n{END}\n\nThe end.\n")
    assert run("evaluate", "tables", "--capture", f"ann={files / 'head.cap'}", "--field",
               files / "head.npz", "--styles", files / "warm.png", "--methods", "skin", "views",
               "--sizes", *SIZES, "--views", 9, "--cone", 30, "--no-speed", "--out", out,
               "--document", document) == 0
    text = document.read_text()
    assert text.startswith("# Ours") and text.endswith("The end.\n") and "outdated" not in text
    assert "### Side by side" in text and text.count(BEGIN) == 1
    assert "### Side by side" in capsys.readouterr().out


@pytest.mark.parametrize("words, message", [
    ((), "name the sitters"),
    (("--capture", "nobody"), "there is no capture nobody"),
    (("--capture", "{cap}:nowhere.npz"), "there is no field nowhere.npz"),
    (("--capture", "{cap}"), "name the styles"),
    (("--capture", "{cap}", "{cap}", "--styles", "{style}"), "two sitters are called 'head'"),
    (("--capture", "{cap}", "--field", "{field}", "{field}"), "2 fields for 1 captures"),
    (("--capture", "{cap}", "--styles", "{style}", "{style}"), "two styles are called 'warm'"),
    (("--capture", "{cap}", "--styles", "{style}", "--methods", "oil"), "no method 'oil'"),
    (("--capture", "{cap}", "--styles", "{style}", "--methods", "skin", "skin"), "named twice"),
    (("--capture", "{cap}", "--styles", "{style}", "--views", "1"), "--views must be 2"),
    (("--capture", "{cap}", "--styles", "{style}", "--cone", "270"), "--cone must lie"),
    (("--capture", "{cap}", "--styles", "{style}", "--sizes", "close-size=8"),
     "close-size must be"),
    (("--capture", "{cap}", "--styles", "{style}", "--sizes", "crops=1"), "crops must be 2"),
    (("--capture", "{cap}", "--styles", "{style}", "--study", "{cap}"), "no results of a study"),
    (("--capture", "{cap}", "--styles", "{style}", "--document", "{style}.md"), "can't read"),
])
def test_mistakes_are_told_in_one_line(words, message, files, tmp_path, capsys):
    places = {"cap": files / "head.cap", "field": files / "head.npz", "style": files / "warm.png"}
    out = tmp_path / "out"
    assert run("evaluate", "tables", "--out", out, *(
        word.format(**places) for word in words)) == 2
    lines = [line for line in capsys.readouterr().err.splitlines()
             if line.startswith("lfportrait:")]
    assert len(lines) == 1 and message in lines[0]
    assert not out.exists()


def test_a_sitter_without_landmarks_is_refused(files, tmp_path, head):
    _, capture = head
    replace(capture, landmarks=None).save(tmp_path / "faceless")
    sources = sources_of((f"{tmp_path / 'faceless'}:{files / 'head.npz'}",))
    with pytest.raises(UserError, match="'faceless' has no facial landmarks"):
        write_tables(sources, styles(files, "warm"), tmp_path / "out", SMALL)


def test_a_field_is_reconstructed_once_and_kept(files, tmp_path, brush, monkeypatch):
    made = []

    def reconstruct(capture: Capture, target: Path, *_):
        made.append(target)
        target.write_bytes((files / "head.npz").read_bytes())
        return {}

    monkeypatch.setattr(running, "field_of", reconstruct)
    sources = sources_of((f"ann={files / 'head.cap'}",))
    for _ in range(2):
        write_tables(sources, styles(files, "warm"), tmp_path,
                     replace(SMALL, methods=("views",)))
    assert made == [tmp_path / "sitters" / "ann" / "field.npz"]


def test_sizes_are_the_given_ones_else_the_presets():
    sizes = TablesConfig(size="full", sizes=("pixels=100", "painted-steps=0")).all_sizes()
    assert sizes.pixels == 100 and sizes.painted_steps == 0 and sizes.painted_size == 576
    assert np.isclose(TablesConfig().all_sizes().network_seconds, 15)


def test_speed_is_told_as_the_paper_tells_it(files, tmp_path, brush, monkeypatch):
    """Times of the parts, and of all views that a field is fitted to."""
    transfers = {name: {"precalculation_seconds": 2.0, "guides_seconds": 0.25,
                        "synthesis_seconds": 0.5, "patch_fidelity": 3.0}
                 for name in ("styleblit", "faceblit", "facestyle", "network")}
    transfers["faceblit"]["published_table_seconds"] = 70.0
    asked = {}

    def transfer(**options):
        asked.update(options)
        return transfers

    mask = {"resolution": "1k", "with_seconds": 0.5, "without_seconds": 0.75,
            "build_seconds": 0.3, "load_seconds": 0.01, "bytes": 2 ** 21, "memory_bytes": 2 ** 22}
    monkeypatch.setattr(running, "bench_masks", lambda *_, **__: [mask])
    monkeypatch.setattr(running, "bench_transfer", transfer)
    figures = compare(files, tmp_path, replace(SMALL, speed=True, methods=("views",)))
    assert figures["fig_6_views"] == 6 and asked["network"].budget == 15
    rows = figures["fig_6"]
    assert rows["styleblit"]["whole_seconds"] == pytest.approx(2 + 6 * 0.75)
    assert rows["faceblit"]["whole_seconds"] == pytest.approx(70 + 6 * 0.75)
    text = (tmp_path / "tables.md").read_text("utf-8")
    assert "| 1k | 0.500 | 0.750 | 0.300 | 0.010 | 2.0 | 4.0 |" in text
    assert "| faceblit | 2.000 | 70.0 | 0.750 | 74.5 | 3.00 |" in text


def test_a_study_stands_beside_the_figures(files, tmp_path, brush):
    row = {"question": "style", "first": "skin", "second": "paper", "share": 0.75, "low": 0.6,
           "high": 0.86, "total": 40}
    (tmp_path / "results.json").write_text(json.dumps({"preferences": [row]}))
    out = tmp_path / "out"
    compare(files, out, replace(SMALL, methods=("views",), study=tmp_path))
    assert ("| style | skin | paper | 75.0 % | 60.0 to 86.0 % | 40 |"
            in (out / "tables.md").read_text("utf-8"))
