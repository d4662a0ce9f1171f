"""The registry of exports: what a file's name asks for, and that each kind is whole."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from lfportrait.errors import UserError
from lfportrait.share import FrameConfig, export_field, export_of, exports, own_exports
from tests.fields import shell_field

SLOW = "numba", "torch", "scipy", "skimage", "cv2", "av"


@pytest.mark.parametrize(("name", "kind", "found"), [
    ("a.ply", "auto", "ply"), ("a.ply", "mesh", "mesh_ply"), ("splats.ply", "auto", "splats_ply"),
    ("splats.ply", "points", "ply"), ("a.glb", "auto", "glb"), ("Splat.GLB", "auto", "splats_glb"),
    ("a.glb", "splats", "splats_glb"), ("a.spz", "auto", "spz"), ("a.zip", "auto", "obj"),
    ("a_2x1.mp4", "auto", "stereo"), ("a.mp4", "auto", "flat"), ("a_qs.png", "auto", "quilt"),
    ("a.png", "pair", "stereo"), ("a.npz", "auto", "checkpoint"), ("a.htm", "auto", "page")])
def test_a_name_asks_for_a_kind(name, kind, found):
    assert export_of(Path(name), kind).name == found


@pytest.mark.parametrize(("name", "kind", "message"), [
    ("a.png", "auto", r"end the name in _qs8x6a0.75 \(Quilt\), _rgbd .*_2x1 .*_anaglyph"),
    ("a.tiff", "auto", "its name must end in .png, "), ("a", "mesh", "or .ply, not a"),
    ("a.glb", "points", "points are written as .ply, not .glb"),
    ("a.glb", "coded", "no kind 'coded'; the kinds are quilt, hop, ")])
def test_a_name_that_asks_for_nothing(name, kind, message):
    with pytest.raises(UserError, match=message):
        export_of(Path(name), kind)


@pytest.mark.parametrize("kind", own_exports(), ids=lambda kind: kind.name)
def test_a_kind_is_whole(kind):
    module, _, name = kind.writer.partition(":")
    assert callable(getattr(import_module(f"lfportrait.share.{module}"), name))
    kind.chosen({option.name: option.default for option in kind.options})
    assert kind.ending.endswith(kind.written) and kind.megabytes > 0 and kind.entry()["title"]


def test_names_are_unlike_each_other():
    assert len(exports()) >= len({kind.name for kind in own_exports()}) == len(own_exports())


def test_parameters_of_another_kind_are_a_mistake(tmp_path):
    with pytest.raises(TypeError, match=r"a\.ply takes ExportConfig, not FrameConfig"):
        export_field(shell_field(size=8), tmp_path / "a.ply", FrameConfig())


def test_the_list_is_there_at_once():
    """The studio's server reads it, and must not wait for what writes the files."""
    done = subprocess.run([sys.executable, "-c", "import sys; from lfportrait import share; "
                           f"share.exports(); print([n for n in {SLOW} if n in sys.modules])"],
                          capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
