"""An installed package adds an export and a format: the one of docs/plugins.md, as it stands."""

import json
import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from lfportrait.capture import Camera, Capture, is_calibrated
from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.plugins import offered
from lfportrait.share import export_field
from tests.fields import shell_field

PAGE = (Path(__file__).parents[1] / "docs" / "plugins.md").read_text("utf-8")
PROJECT, MODULE = (re.search(rf"```{language}\n(.*?)```", PAGE, re.S)[1]
                   for language in ("toml", "python"))


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Put a package where Python finds it, as an installer does: module and entry points."""
    def installed(module=MODULE, project=PROJECT):
        place, about = tmp_path / "site", tomllib.loads(project)["project"]
        facts = place / f"{about['name']}-{about['version']}.dist-info"
        facts.mkdir(parents=True)
        (place / f"{about['name']}.py").write_text(module)
        (facts / "METADATA").write_text(f"Name: {about['name']}\nVersion: {about['version']}\n")
        (facts / "entry_points.txt").write_text("\n".join(
            f"[{group}]\n" + "\n".join(f"{name} = {value}" for name, value in named.items())
            for group, named in about["entry-points"].items()))
        monkeypatch.syspath_prepend(place)
        offered.cache_clear()

    yield installed
    sys.modules.pop("workshop", None)
    offered.cache_clear()


@pytest.fixture
def head(tmp_path):
    """A field's file."""
    shell_field(size=20).save(tmp_path / "head.npz")
    return tmp_path / "head.npz"


def capture(mattes=False):
    """Three pictures of a rig, with a frame that is kept as it is."""
    places = np.array([[0, 0, 3.0], [1, 0, 2.8], [-1, 0.2, 2.8]])
    cameras = Camera.look_at(places, np.zeros(3), width=12, height=9, focal=15.0)
    random = np.random.default_rng(0)
    images = [random.integers(0, 255, (9, 12, 3), np.uint8) for _ in places]
    alphas = [random.integers(0, 255, (9, 12), np.uint8) for _ in places] if mattes else None
    return Capture(cameras, images, alphas, ["a.png", "b.jpg", "c.png"], np.zeros(3, bool))


def test_the_command_line_lists_and_writes_its_export(install, head, capsys, tmp_path):
    install()
    assert main(["formats"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.split()[:2] == ["stl", ".stl"] and "For 3D printers" in line for line in lines)
    assert any(line.split() == ["Rig", "rig.json", "(written,", "too)"] for line in lines)
    words = ["export", str(head), "--json", str(tmp_path / "run.json"), "--out"]
    assert main([*words, str(tmp_path / "head.stl"), "--stl.height", "50"]) == 0
    figures = json.loads((tmp_path / "run.json").read_text())
    said = capsys.readouterr().out
    assert figures["kind"] == "stl" and f"{figures['faces']:,} faces" in said
    data = (tmp_path / "head.stl").read_bytes()
    assert len(data) == figures["bytes"] == 84 + 50 * figures["faces"]
    corners = np.frombuffer(data[84:], "3<f4, (3,3)<f4, <u2")["f1"]
    assert 10 < np.abs(corners).max() < 25
    with pytest.raises(SystemExit):
        main(["export", "--help-all"])
    assert "--stl.height" in capsys.readouterr().out
    assert main([*words, str(tmp_path / "head.ply"), "--kind", "stl"]) == 2
    assert "stl is written as .stl, not .ply" in capsys.readouterr().err
    assert main([*words, str(tmp_path / "head.xyz")]) == 2
    assert ".stl" in capsys.readouterr().err


def test_the_studio_offers_it(install):
    pytest.importorskip("starlette")
    from lfportrait.studio.exports import checked_options, kind_of, kinds

    install()
    (card,) = [one for one in kinds() if one["kind"] == "stl"]
    assert (card["title"], card["suffix"], card["group"]) == ("STL model", ".stl", "solid")
    assert card["options"][0] == {
        "name": "height", "note": "Of the head in mm", "default": 100.0, "min": 1, "max": 1000,
        "choices": None, "type": "number"}
    assert kind_of("stl").chosen(checked_options(kind_of("stl"), {"height": 5})).height == 5


def test_its_format_is_written_and_read(install, tmp_path, capsys):
    with pytest.raises(UserError, match="not written as 'Rig', but as lfportrait capture"):
        capture().save(tmp_path / "rig", format="Rig")
    install()
    capture().save(tmp_path / "rig", format="Rig")
    assert is_calibrated(tmp_path / "rig") and not is_calibrated(tmp_path)
    found = Capture.load(tmp_path / "rig", holdout=0)
    assert found.names == ["a.png", "b.png", "c.png"]  # mattes need files with alpha
    assert all(np.array_equal(*pair) for pair in zip(found.images, capture().images, strict=True))
    assert np.allclose(found.cameras.focal, 15) and found.alphas is None
    capture(mattes=True).save(tmp_path / "cut", format="Rig")
    cut = Capture.load(tmp_path / "cut", holdout=0)
    assert all(np.array_equal(*pair) for pair in zip(cut.alphas, capture(True).alphas, strict=True))
    assert main(["inspect", str(tmp_path / "rig")]) == 0
    assert "Rig" in capsys.readouterr().out
    with pytest.raises(UserError, match=r"it has no transforms.json, .* or rig.json; run"):
        Capture.load(tmp_path)


def spoiled(old, new):
    """The package with a fault."""
    assert old in MODULE
    return MODULE.replace(old, new)


@pytest.mark.parametrize(("module", "line"), [
    (spoiled("import numpy as np", "import nothing_like_it"), "No module named 'nothing_like_it'"),
    (spoiled("import numpy as np", "1 / 0"), "division by zero"),
    (spoiled("class Stl(Export)", "class Stl"), "it is no subclass of Export"),
    (spoiled("def write(self, field", "def written(self, field"), "abstract method"),
    (spoiled('"stl", "STL model", "For 3D printers"', '"glb", "a", "b"'), "there is glb already"),
    (spoiled("name, title, purpose =", "name, title, other ="), "it has no purpose"),
    (spoiled("parameters = StlConfig", "parameters = dict"), "are no data class"),
    (spoiled('mm", 100.0, 1, 1000)', 'mm", None)'), "option height is no number, text or choice"),
    (spoiled("height: float = 100.0", "height: float"), "missing 1 required")])
def test_a_broken_export_is_left_out_with_a_line(install, head, capsys, tmp_path, module, line):
    install(module)
    assert main(["export", str(head), "--out", str(tmp_path / "p.ply"), "--quiet"]) == 0
    warnings = [one for one in capsys.readouterr().err.splitlines() if "left out" in one]
    assert warnings and all(one.startswith("warning: ") for one in warnings)
    assert any(line in one for one in warnings)


def test_an_export_that_fails_is_one_line_and_leaves_no_file(install, head, capsys, tmp_path):
    install(spoiled("        mesh = field_mesh(field)", "        mesh = field_mesh(field).nothing"))
    assert main(["export", str(head), "--out", str(tmp_path / "head.stl"), "--quiet"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("lfportrait: Stl of the package workshop failed: AttributeError: ")
    number = MODULE[:MODULE.index("mesh = field_mesh")].count("\n") + 1
    assert line.endswith(f" (workshop.py, line {number})")
    assert not (tmp_path / "head.stl").exists()


@pytest.mark.parametrize("fault", ["raise OSError('no such disk')", "return np.nothing"])
def test_a_format_that_fails_harms_no_other_folder(install, tmp_path, fault):
    install(spoiled("return (path / self.files).is_file()", fault))
    with pytest.warns(UserWarning, match="Rig of the package workshop failed"):
        assert not is_calibrated(tmp_path)
    capture().save(tmp_path / "own")
    assert is_calibrated(tmp_path / "own") and len(Capture.load(tmp_path / "own")) == 3


def test_a_format_that_can_not_read_is_one_line(install, tmp_path):
    install(spoiled("return DataSet(self.name, shots", "return [][1](self.name, shots"))
    capture().save(tmp_path / "rig", format="Rig")
    with pytest.raises(UserError, match="Rig of the package workshop failed: IndexError"):
        Capture.load(tmp_path / "rig")


def test_our_own_faults_stay_ours(tmp_path, monkeypatch):
    monkeypatch.setattr("lfportrait.share.writers.field_points", lambda *_: {}["nothing"])
    with pytest.raises(KeyError):
        export_field(shell_field(size=8), tmp_path / "p.ply")
