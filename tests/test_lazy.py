"""What is not asked for is not imported: quick commands do not wait for slow libraries."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import lfportrait

SLOW = ("numba", "torch", "scipy", "skimage", "cv2", "mediapipe", "pycolmap", "av")

LIGHT = ("--help", "--version", "display list", "display show generic-4k", "styles", "models list")

SCRIPT = f"""
import sys
from lfportrait.cli import main
for words in {LIGHT!r}:
    print("$", words)
    print(words, main(words.split()), *[name for name in {SLOW!r} if name in sys.modules],
          file=sys.stderr)
"""


def test_light_commands_load_nothing_slow():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True,
                          check=True)
    assert done.stderr.splitlines() == [f"{words} 0" for words in LIGHT]
    said = done.stdout.split("$ ")[1:]
    assert len(said) == len(LIGHT) and all(text.count("\n") > 1 for text in said)


PACKAGES = ("lfportrait", "lfportrait.capture", "lfportrait.cli", "lfportrait.demo",
            "lfportrait.example", "lfportrait.face", "lfportrait.field",
            "lfportrait.field.closing", "lfportrait.field.geometry", "lfportrait.field.gpu",
            "lfportrait.job", "lfportrait.job.batch", "lfportrait.lightfield",
            "lfportrait.lightfield.prints", "lfportrait.lightfield.screens", "lfportrait.share",
            "lfportrait.studio", "lfportrait.stylize", "lfportrait_eval.baselines.transfer")
"""Those with a stub, which says where their names are."""


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_there(package):
    module = importlib.import_module(package)
    stub = Path(module.__file__).with_suffix(".pyi")
    public = next(ast.literal_eval(node.value) for node in ast.parse(stub.read_text("utf-8")).body
                  if isinstance(node, ast.Assign))
    assert sorted(public) == sorted(module.__all__), "it is typed as what it is"
    assert {*module.__all__} <= {*dir(module)}
    for name in module.__all__:
        assert not isinstance(getattr(module, name), ModuleType), name


def test_every_stub_is_looked_at():
    source = Path(lfportrait.__file__).parents[1]
    found = [path.parent.relative_to(source) for path in source.glob("lfportrait*/**/*.pyi")]
    assert sorted(".".join(path.parts) for path in found) == sorted(PACKAGES)


def test_a_function_may_have_its_package_s_name():
    importlib.import_module("lfportrait.stylize")
    with pytest.raises(TypeError, match="capture"):
        lfportrait.stylize(None)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nothing"):
        lfportrait.nothing  # noqa: B018
