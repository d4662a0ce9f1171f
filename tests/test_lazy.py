"""What is not asked for is not imported: quick commands do not wait for slow libraries."""

import ast
import gc
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

import lfportrait
from lfportrait.lazy import attach, syntax_tree

SLOW = ("numba", "torch", "scipy", "skimage", "cv2", "mediapipe", "pycolmap", "av")

SCRIPT = """
import sys
from lfportrait.cli import main
code = main(sys.argv[1:])
print("loaded:", *[name for name in {slow!r} if name in sys.modules], file=sys.stderr)
sys.exit(code)
"""


@pytest.mark.parametrize("words", ["--help", "--version", "display list",
                                   "display show generic-4k", "styles", "models list"])
def test_light_commands_load_nothing_slow(words):
    done = subprocess.run([sys.executable, "-c", SCRIPT.format(slow=SLOW), *words.split()],
                          capture_output=True, text=True, check=True)
    assert done.stdout
    assert done.stderr.strip() == "loaded:"


def test_every_public_name_is_there():
    for package in ("lfportrait", "lfportrait.lightfield", "lfportrait.example",
                    "lfportrait.demo", "lfportrait.stylize", "lfportrait.capture",
                    "lfportrait.field"):
        module = sys.modules.get(package) or __import__(package, fromlist=["x"])
        assert set(module.__all__) - {"__version__"} <= set(dir(module)), package
        for name in module.__all__:
            thing = getattr(module, name)
            assert callable(thing) or not isinstance(thing, type(sys)), f"{package}.{name}"


def test_a_function_may_have_its_package_s_name():
    from lfportrait.stylize import stylize

    assert stylize is not lfportrait.stylize  # the package, by now
    with pytest.raises(TypeError, match="capture"):
        lfportrait.stylize(None)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        lfportrait.nothing  # noqa: B018


def test_a_name_that_moved_says_where_it_is():
    with pytest.raises(AttributeError, match="it is in lfportrait_eval now"):
        lfportrait.evaluate  # noqa: B018


def test_names_come_from_the_imports_that_type_checkers_see(tmp_path):
    file = tmp_path / "__init__.py"
    file.write_text("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n"
                    "    from .path import join as joined\n    from .path import split\n")
    get, names = attach("os", str(file))
    # Beside what the package has already.
    assert {"joined", "split", "getcwd"} <= set(names()) and names() == sorted(names())
    assert "TYPE_CHECKING" not in names()
    with pytest.raises(AttributeError):
        get("TYPE_CHECKING")
    assert get("split").__name__ == "split"


def test_texts_are_parsed_from_several_threads():
    """Python 3.11 counts the depths of trees that threads build at a time together."""
    text = "x = [" + ", ".join(f"f({n}, (a, [b, {{c: d}}]))" for n in range(50)) + "]\n"
    before = gc.get_threshold()
    gc.set_threshold(300)  # what is called then may let another thread go on

    def pause(*_):
        time.sleep(0.0005)

    gc.callbacks.append(pause)
    try:
        with ThreadPoolExecutor(4) as threads:
            trees = list(threads.map(syntax_tree, [text] * 30))
    finally:
        gc.callbacks.remove(pause)
        gc.set_threshold(*before)
    assert len({ast.dump(tree) for tree in trees}) == 1
