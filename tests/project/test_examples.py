"""The examples run on tiny data, draw what they say, and their pages follow from them."""

import ast
import functools
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lfportrait as lf
import make_examples
from lfportrait import models
from lfportrait.demo import demo_exemplar
from tests.job.batch.inline import Inline

ROOT = Path(__file__).parents[2]
EXAMPLES = make_examples.examples()
NAMES = [one.path.stem for one in EXAMPLES]

PANEL = lf.Display(160, 90, views=12, pitch=6.3, slant=0.15, name="tiny")
PAINTING = lf.StylizeConfig(pixels=48, fit_iterations=1, steps=1, content_network="embedded",
                            style_network="embedded")
SMALL = {
    "01_portrait": {
        "size": 64, "views": 16,
        "config": lf.ReconstructConfig(resolutions=(32, 64), rays=(0.05, 0.05)),
        "painting": PAINTING},
    "02_photo": {},
    "03_style": {"size": 64, "painting": PAINTING},
    "04_display": {"width": 160, "height": 90},
    "05_renderer": {"width": 96, "height": 64},
    "06_live": {"width": 96, "height": 64},
    "07_print": {"size": "30x40mm", "dpi": 240.0},
    "08_splats": {"size": 64, "count": 2000, "steps": 2},
    "09_batch": {"size": 64, "levels": (16, 32), "rays": 0.04, "pixels": 48.0, "width": 96,
                 "height": 64},
    "10_losses": {"size": 64, "steps": 2},
    "11_head": {"resolution": 64, "size": 64, "painting": PAINTING},
    "12_skin": {"pixels": 48.0},
}
"""Arguments of `main`, for seconds instead of minutes."""
WRITTEN = {
    "01_portrait": ((64, 256), ["lightfield.png", "portrait.html", "styled.npz", "field.npz"]),
    "02_photo": ((64, 176), []), "03_style": ((64, 192), ["poster.png"]),
    "04_display": ((180, 320), ["mine.toml"]), "05_renderer": ((64, 288), []),
    "06_live": ((64, 288), []), "07_print": (None, ["print.png"]),
    "08_splats": ((64, 192), ["head.spz", "head.glb"]),
    "09_batch": ((64, 128), ["jobs.toml", "results/index.html"]), "10_losses": ((64, 256), []),
    "11_head": ((64, 384), ["one.npz", "painted.npz"]), "12_skin": (None, []),
}
"""Size of the picture, and other files that are written."""


def run(name: str, out: Path) -> None:
    path = ROOT / "examples" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"example_{name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(out, **SMALL[name])


@pytest.fixture(scope="module")
def first(tmp_path_factory) -> Path:
    """A folder with what the first example writes; the others read that."""
    out = tmp_path_factory.mktemp("examples")
    PANEL.save(out / "tiny.toml")
    # A painting of the usual size takes longer.
    small = functools.partial(demo_exemplar, width=180, height=240)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lfportrait.demo.demo_exemplar", small)
        SMALL["01_portrait"]["panel"] = str(out / "tiny.toml")
        run("01_portrait", out)
        yield out


def test_every_example_is_run():
    assert list(SMALL) == list(WRITTEN) == NAMES


# They take the same paths as the tests of what they show.
@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_an_example_draws_what_its_page_shows(name, first, request, monkeypatch):
    if name == "11_head" and models.missing(["face-landmarker"]):
        pytest.skip("the network for landmarks is not here")
    # That a batch has processes of its own is tested with it; they take most of its time here.
    monkeypatch.setattr("lfportrait.job.batch.driver.LocalRunner", Inline)
    if name == "06_live":
        request.getfixturevalue("adapter")
        # A process of its own: drivers in software do not live long.
        subprocess.run([sys.executable, "-c", "import runpy, sys, pathlib; runpy.run_path("
                        "sys.argv[1])['main'](pathlib.Path(sys.argv[2]), 96, 64)",
                        ROOT / "examples" / f"{name}.py", first], check=True)
    elif name != "01_portrait":
        if "03_style" in EXAMPLES[NAMES.index(name)].run and not (first / "poster.png").exists():
            run("03_style", first)
        run(name, first)
    size, others = WRITTEN[name]
    image = lf.read_image(first / EXAMPLES[NAMES.index(name)].picture)
    assert size is None or image.shape[:2] == size
    assert image.std() > 10
    assert [file for file in others if not (first / file).is_file()] == []


@pytest.mark.slow  # of an example
def test_eyes_see_different_pictures(first):
    if not (first / "display.png").is_file():
        run("04_display", first)
    eyes = lf.read_image(first / "display.png").astype(int)
    assert np.abs(eyes[:90, :160] - eyes[90:, :160]).max() > 30


@pytest.mark.parametrize("one", EXAMPLES, ids=NAMES)
def test_examples_are_short_and_use_public_names_alone(one):
    source = one.path.read_text("utf-8")
    assert len(source.splitlines()) < 66
    assert one.title and one.subtitle and "Key concepts:" in one.text
    assert one.path.name in one.run
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            ours = [alias for alias in node.names if "lfportrait" in alias.name]
            assert [(alias.name, alias.asname) for alias in ours] in ([], [("lfportrait", "lf")])
        elif isinstance(node, ast.ImportFrom):
            assert "lfportrait" not in str(node.module), "import lfportrait as lf"
    assert set(re.findall(r"\blf\.(\w+)", source)) <= set(lf.__all__)


def test_the_committed_pages_are_up_to_date():
    pages = make_examples.pages()
    assert {path: path.read_text("utf-8") for path in pages} == pages, (
        "run python scripts/make_examples.py")
    assert set(make_examples.PAGES.glob("*.md")) == {
        path for path in pages if path.parent == make_examples.PAGES}


def test_pictures_are_those_of_examples():
    assert {path.stem for path in make_examples.PICTURES.glob("*.jpg")} <= {
        one.name for one in EXAMPLES}
