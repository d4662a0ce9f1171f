"""Commands and methods of other packages, found by their entry points."""

import subprocess
import sys
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pytest
import tyro
from PIL import Image

from lfportrait import plugins
from lfportrait.cli import Common, main
from lfportrait.errors import UserError
from lfportrait.example import PhotoMethod
from lfportrait.face import write_landmarks
from lfportrait.files import read_json, write_image
from lfportrait.job.graph import MakeConfig, style_key
from lfportrait.media.pictures import read_image
from lfportrait.plugins import Choice, chosen, offered, provided_sittings, provided_styles
from lfportrait.stylize import FieldMethod, StylizeConfig
from lfportrait_eval.baselines.field import ArfConfig, RefNprConfig
from tests.portraits import drawn_face


@pytest.fixture
def bring(monkeypatch):
    """Pretends that a package brings something under a name in a group."""
    known = {}

    def found(group):
        return known.get(group, [])

    def brought(group, name, thing):
        def load():
            if isinstance(thing, Exception):
                raise thing
            return thing

        known.setdefault(group, []).append(SimpleNamespace(name=name, value="there", load=load))
        offered.cache_clear()

    monkeypatch.setattr(plugins, "entry_points", found)
    offered.cache_clear()
    yield brought
    offered.cache_clear()


def test_what_is_offered_has_an_order_and_what_is_broken_is_left_out(bring):
    bring("g", "two", int)
    bring("g", "one", str)
    bring("g", "bad", ImportError("no torch"))
    with pytest.warns(UserWarning, match="bad .there. is left out: no torch"):
        assert list(offered("g").items()) == [("one", str), ("two", int)]
    assert chosen("g", "two") is int and offered("h") == {}
    with pytest.raises(UserError, match="no method 'three'; the installed ones are mine, one, two"):
        chosen("g", "three", ("mine",))


def test_a_choice_knows_its_names_when_it_is_read(bring, capsys):
    @dataclass
    class Options:
        method: Annotated[str, Choice("g", "mine")] = "mine"

    bring("g", "other", int)
    assert tyro.cli(Options, args=["--method", "other"]).method == "other"
    with pytest.raises(SystemExit):
        tyro.cli(Options, args=["--method", "third"])
    assert "'mine', 'other'" in " ".join(capsys.readouterr().err.split())


def test_exemplars_and_photos_of_packages(bring):
    bring("lfportrait.styles", "one", lambda: {"ink": int, "oil": str})
    bring("lfportrait.styles", "two", lambda: {"chalk": float})
    assert provided_styles() == {"ink": int, "oil": str, "chalk": float}
    with pytest.raises(UserError, match="no photos to train on"):
        provided_sittings(3, 48, 7)
    bring("lfportrait.sittings", "heads", lambda *asked: [asked])
    assert provided_sittings(3, 48, 7) == [(3, 48, 7)]


def test_entry_points_are_not_read_before_somebody_asks(monkeypatch):
    def never(group):
        raise AssertionError(group)

    monkeypatch.setattr(plugins, "entry_points", never)
    hints = Annotated[str, Choice("g", "mine")]
    assert hints.__metadata__[0] == hints.__metadata__[0] and hash(hints)
    StylizeConfig().check()
    with pytest.raises(AssertionError):
        hints.__metadata__[0].choices  # noqa: B018


@dataclass
class Hello(Common):
    """Says hello."""

    times: int = 1
    """How often."""

    def run(self):
        print("hello " * self.times)
        return {"times": self.times}


def test_a_command_of_another_package_runs_as_ours_do(bring, capsys, tmp_path):
    bring("lfportrait.commands", "hello", Hello)
    bring("lfportrait.commands", "say.hello", Hello)
    assert main(["hello", "--times", "2", "--json", str(tmp_path / "run.json")]) == 0
    assert capsys.readouterr().out.split() == ["hello"] * 2
    assert read_json(tmp_path / "run.json")["times"] == 2
    assert main(["say", "hello"]) == 0
    assert main(["say"]) == 2
    assert "unknown command 'say'" in capsys.readouterr().err


@dataclass(frozen=True)
class Flat:
    """One color."""

    grey: float = 0.5
    """Which."""
    seed: int = 0


def flat(exemplar, config, own):
    def apply(image, landmarks):
        return SimpleNamespace(image=np.full(image.shape, config.grey, np.float32),
                               seconds={"seed": config.seed}, dump=lambda folder: None)

    return SimpleNamespace(apply=apply)


def test_a_method_of_transfer_of_another_package(bring, tmp_path, monkeypatch, capsys):
    bring("lfportrait.transfer_methods", "flat-grey", PhotoMethod(Flat, flat))
    face = drawn_face(96, 80)
    Image.fromarray(face.image).save(tmp_path / "style.png")
    write_landmarks(tmp_path / "style.landmarks.txt", face.landmarks)
    write_image(tmp_path / "photo.png", face.image)
    monkeypatch.setattr("lfportrait.face.detect_landmarks", lambda image: face.landmarks)
    words = ["transfer", str(tmp_path / "photo.png"), "--style", str(tmp_path / "style.png"),
             "--out", str(tmp_path / "out.png"), "--json", str(tmp_path / "run.json"),
             "--method", "flat-grey", "--flat-grey.grey", "0.2", "--seed", "3"]
    assert main(words) == 0
    assert np.abs(read_image(tmp_path / "out.png") - 51).max() <= 1
    figures = read_json(tmp_path / "run.json")
    assert figures["method"] == "flat-grey" and figures["seed"] == 3
    with pytest.raises(SystemExit):
        main(["transfer", "--help-all"])
    assert "--flat-grey.grey" in capsys.readouterr().out


@dataclass(frozen=True)
class Dull:
    """Grey colors."""

    level: float = 0.5


@dataclass(frozen=True)
class Bright:
    """White colors."""


def test_parameters_of_a_method_that_colors_a_field(bring):
    bring("lfportrait.field_methods", "dull-one", FieldMethod(
        Dull, flat, needs_face=False, networks=("adain",)))
    bring("lfportrait.field_methods", "bright", FieldMethod(Bright, flat))
    config = StylizeConfig(method="dull-one")
    assert config.parameters_of(config.other) == Dull()
    assert config.networks == ("adain",) and not config.needs_face
    config.check()
    dark = config.with_section(Dull(0.1)).with_section(Bright())
    assert dark.parameters_of(dark.other) == Dull(0.1) and len(dark.parameters) == 2
    assert dark.with_section(Dull(0.2)).section("dull_one") == Dull(0.2)
    assert dark.section("dull_one") == Dull(0.1) and dark.section("skin") is None
    own = StylizeConfig()
    assert own.other is None and own.needs_face and own.networks == ()
    with pytest.raises(UserError, match="no method 'arf'; the installed ones are skin, paper, b"):
        StylizeConfig(method="arf").check()


@pytest.mark.parametrize("words, program", [
    (["stylize", "f.npz", "--capture", "c", "--style", "s", "--arf.steps", "7", "--ref-npr.size",
      "96", "--method", "ref-npr"], "Stylize"),
    (["make", "photos", "--style", "s", "--out", "o", "--stylize.arf.steps", "7",
      "--stylize.ref-npr.size", "96", "--stylize.method", "ref-npr"], "Make"),
    (["evaluate tables", "--stylize.arf.steps", "7", "--stylize.ref-npr.size", "96"], "Tables")])
def test_parameters_of_methods_are_options(words, program):
    """Only what differs from the defaults is handed on: the same job, the same key."""
    from lfportrait.cli.common import parsed
    from lfportrait.cli.dispatch import _command_class

    command = parsed(_command_class(words[0]), words[1:], "lfportrait")
    assert type(command).__name__ == program
    assert {type(one).__name__: vars(one) for one in command.given} == {
        "ArfConfig": vars(ArfConfig(steps=7)), "RefNprConfig": vars(RefNprConfig(size=96))}


def test_the_code_of_a_method_is_part_of_the_key_of_what_it_makes():
    keys = {name: style_key("field", MakeConfig(stylize=StylizeConfig(method=name)), ("a", "b"))
            for name in ("skin", "paper", "arf")}
    assert len(set(keys.values())) == 3
    assert StylizeConfig(method="paper").maker.startswith("lfportrait.")
    assert StylizeConfig(method="arf").maker == "lfportrait_eval.baselines.field.methods"


WITHOUT = '''
import sys

class Absent:
    """As if the laboratory were not installed."""

    def find_spec(self, name, *_):
        if name == "lfportrait_eval":
            raise ModuleNotFoundError(name, name=name)

sys.meta_path.insert(0, Absent())
from lfportrait.cli import main
assert main(["--help"]) == 0
assert main(["evaluate", "job"]) == 2
assert main(["transfer", "--help-all"]) == 0
'''


@pytest.mark.slow  # nor does it import it: tests/project
def test_the_product_does_without_the_laboratory():
    done = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (
        "lfportrait: evaluate is a command of the evaluation package: pip install lfportrait-eval "
        "(in a checkout: pip install -e src/lfportrait_eval)\n") in done.stderr
    assert "--method {styleblit}" in done.stdout
