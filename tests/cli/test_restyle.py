"""The command that mixes a styled field anew: options repeated or in a row, mistakes, its file."""

import json
import subprocess
import sys

import numpy as np
import pytest

from lfportrait.cli import main
from lfportrait.stylize import StyledField
from tests.fields import shell_field


@pytest.fixture(scope="module")
def styled(tmp_path_factory):
    """A styled field of two styles and three regions on the disk."""
    field = shell_field(size=10, basis=1)
    count = len(field.density)
    random = np.random.default_rng(0)
    path = tmp_path_factory.mktemp("styled") / "styled.npz"
    labels = np.zeros((count, 3), np.uint8)
    labels[np.arange(count), np.arange(count) % 3] = 255
    StyledField.of(field, random.random((2, count, 3)), ("ken", "ink"), random.random((count, 3)),
                   labels, ("hair", "lips", "eyes")).save(path)
    return path


def restyled(styled, tmp_path, *words):
    """The field and the figures of a run."""
    out, figures = tmp_path / "mixed.npz", tmp_path / "run.json"
    assert main(["restyle", str(styled), *words, "--out", str(out), "--json", str(figures)]) == 0
    return StyledField.load(out), json.loads(figures.read_text())


@pytest.mark.parametrize("words", ["--region hair=2 --region lips=ink:0.5 --keep eyes",
                                   "--region hair=2 lips=ink:0.5 --keep eyes",
                                   "--keep eyes --region lips=0.1 --region hair=2 lips=ink:0.5"])
def test_regions_are_given_one_by_one_or_in_a_row(styled, tmp_path, words):
    mixed, figures = restyled(styled, tmp_path, *words.split())
    wanted = StyledField.load(styled).mix(regions={"hair": 2.0, "lips": ("ink", 0.5)},
                                          keep=("eyes",))
    assert np.allclose(mixed.sh, wanted.sh, atol=2e-3)
    assert mixed.mixture == figures["mix"]
    assert figures["mix"]["regions"] == {"hair": 2.0, "lips": ["ink", 0.5]}
    assert figures["mix"]["keep"] == ["eyes"]


def test_all_other_options_arrive(styled, tmp_path):
    mixed, figures = restyled(styled, tmp_path, "--strength", "0.5", "--identity", "0.25",
                              "--style", "ink", "--keep-colors", "--keep", "eyes", "--keep", "lips")
    assert mixed.mixture == {"strength": 0.5, "identity": 0.25, "style": "ink", "regions": {},
                             "keep_colors": True, "keep": ["eyes", "lips"]}
    assert figures["styles"] == ["ken", "ink"] and figures["regions"] == ["hair", "lips", "eyes"]
    assert set(figures["seconds"]) == {"wall", "load", "mix", "save"}
    assert figures["voxels"] == len(mixed.density)


def test_the_result_can_be_mixed_again(styled, tmp_path):
    mixed, _ = restyled(styled, tmp_path, "--strength", "0")
    again, _ = restyled(tmp_path / "mixed.npz", tmp_path)
    assert not np.allclose(mixed.sh, again.sh, atol=0.1)
    assert np.allclose(again.sh, StyledField.load(styled).mix().sh, atol=2e-3)


@pytest.mark.parametrize("words, told", [
    ("--strength 2", "the strength must be a number from 0 to 1"),
    ("--region beard=1", "no region 'beard' here; there are hair, lips, eyes"),
    ("--region hair", "can't read the region 'hair'"),
    ("--region hair=oil", "no style 'oil' in this field; it has ken, ink"),
    ("--style oil", "no style 'oil' in this field; it has ken, ink"),
    ("--keep nose", "no region 'nose' here; there are hair, lips, eyes")])
def test_mistakes_are_told_in_one_line_and_nothing_is_written(styled, tmp_path, capsys, words,
                                                              told):
    out = tmp_path / "mixed.npz"
    assert main(["restyle", str(styled), *words.split(), "--out", str(out)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and told in lines[0]
    assert not out.exists()


def test_a_field_that_was_never_stylised_is_told(tmp_path, capsys):
    shell_field(size=8).save(tmp_path / "field.npz")
    np.save(tmp_path / "array.npy", np.zeros(3))
    for name, told in (("field.npz", "run that again"), ("none.npz", "no such field file"),
                       ("array.npy", "is not a field")):
        assert main(["restyle", str(tmp_path / name), "--out", str(tmp_path / "out.npz")]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1 and told in lines[0]
    assert not (tmp_path / "out.npz").exists()


@pytest.mark.slow  # a process of its own
def test_torch_is_not_waited_for(styled, tmp_path):
    script = ("import sys\nfrom lfportrait.cli import main\ncode = main(sys.argv[1:])\n"
              "print(*[name for name in ('torch', 'mediapipe') if name in sys.modules])\n"
              "sys.exit(code)")
    done = subprocess.run([sys.executable, "-c", script, "restyle", str(styled), "--out",
                           str(tmp_path / "out.npz")], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
