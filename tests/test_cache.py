"""Hashes of what things are made of, and what is kept under them."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from lfportrait import cache
from lfportrait.cache import kept_arrays, tried, user_cache
from lfportrait.job.graph import STAGES
from lfportrait.sources import Kept, Sources


@pytest.fixture
def make():
    """Makes an array, and counts how often."""
    def made():
        made.times += 1
        return {"one": np.arange(3.0), "two": np.array("words")}
    made.times = 0
    return made


def test_arrays_are_made_once(make, tmp_path):
    first = kept_arrays("things", "a", make, tmp_path / "kept")
    again = kept_arrays("things", "a", make, tmp_path / "kept")
    assert make.times == 1 and first.keys() == again.keys()
    assert np.array_equal(first["one"], again["one"]) and str(again["two"]) == "words"
    kept_arrays("things", "b", make, tmp_path / "kept")
    assert make.times == 2


def test_a_damaged_file_is_made_anew(make, tmp_path):
    kept_arrays("things", "a", make, tmp_path)
    whole = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(whole[:len(whole) // 2])
    assert np.array_equal(kept_arrays("things", "a", make, tmp_path)["one"], np.arange(3.0))
    assert make.times == 2 and (tmp_path / "a.npz").read_bytes() == whole


def test_where_nothing_can_be_written_they_are_made_each_time(make, tmp_path):
    (tmp_path / "taken").write_text("a file, no folder")
    for _ in range(2):
        assert kept_arrays("things", "a", make, tmp_path / "taken")["one"][2] == 2
    assert make.times == 2


def test_what_was_not_used_for_long_goes(make, tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "MOST", 3)
    for age, name in enumerate("abc"):
        kept_arrays("things", name, make, tmp_path)
        os.utime(tmp_path / f"{name}.npz", (1000 + age, 1000 + age))
    kept_arrays("things", "a", make, tmp_path)
    kept_arrays("things", "d", make, tmp_path)
    assert sorted(file.stem for file in tmp_path.iterdir()) == ["a", "c", "d"]


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """A copy of the package's sources."""
    copy = tmp_path_factory.mktemp("copy") / "lfportrait"
    shutil.copytree(Path(cache.__file__).parent, copy,
                    ignore=shutil.ignore_patterns("__pycache__", "*.nb?", "*.safetensors"))
    return copy, Text()


class Text:
    """Keeps a text."""

    text = None

    @property
    def kept(self):
        return Kept(lambda: self.text, lambda text: setattr(self, "text", text))


@pytest.fixture
def package(copied):
    """Which stages are stale when a file of the package changes."""
    copy, text_of_modules = copied

    def stale(file, old, new):
        def hashes():
            sources = Sources(copy, text_of_modules.kept)
            return {stage: sources.code_of(makers) for stage, makers in MAKERS.items()}

        before, path = hashes(), copy / file
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        after = hashes()
        path.write_text(text, encoding="utf-8")
        return {stage for stage in MAKERS if before[stage] != after[stage]}

    return stale


MAKERS = {name: stage.makers for name, stage in STAGES.items() if name not in ("skin", "share")}


@pytest.mark.parametrize(("file", "old", "new", "stages"), [
    ("lightfield/coding.py", "import", "import ", {"encode"}),
    ("stylize/losses.py", "import", "import ", {"stylize"}),
    ("share/page/assembly.py", "import", "import ", {"page"}),
    ("capture/photo_cameras.py", "import", "import ", {"capture"}),
    ("face/face_cameras.py", "import", "import ", {"capture"}),
    ("field/trimming.py", "import", "import ", {"field"}),
    ("errors.py", "class", "class ", set(MAKERS)),
    ("cli/make.py", "import", "import ", set())])
def test_a_change_makes_stale_what_runs_it_and_nothing_else(package, file, old, new, stages):
    assert package(file, old, new) == stages


def test_files_that_a_module_names_are_part_of_it(package, copied):
    file = next((copied[0] / "share" / "page").rglob("*.js"))
    text = file.read_text(encoding="utf-8")
    assert package(file.relative_to(copied[0]), text[:20], "//" + text[:20]) == {"page"}


def test_what_nothing_is_made_by_is_no_key():
    with pytest.raises(KeyError):
        cache.key_of("field.no_such_module", 1)


def test_imports_are_looked_through(tmp_path):
    """Front doors, late ones, those for type checkers, functions named as their modules."""
    root = tmp_path / "lfportrait"
    for name, text in {
            "__init__.py": "", "a.py": "from .b import One\n", "b/__init__.py": (
                "from typing import TYPE_CHECKING\nfrom .three import three\n"
                "if TYPE_CHECKING:\n    from .one import One\n    from .two import Two\n"),
            "b/one.py": "def f():\n    from .. import c\nclass One: pass\n",
            "d/__init__.py": "def f():\n    from .one import x\ndef g():\n    from .two import x\n",
            "d/one.py": "", "d/two.py": "", "e.py": "from . import d\nd.f()\n",
            "b/two.py": "", "b/three.py": "def three(): pass\n", "c.py": (
                "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .b import Two\n"
                "from .b import three\nimport numpy\n")}.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    assert Sources(root).closure(["a"]) == {
        f"lfportrait.{name}" for name in ("a", "b.one", "c", "b.three")}
    assert Sources(root).closure(["e"]) == {"lfportrait.e", "lfportrait.d", "lfportrait.d.one"}
    assert "lfportrait.d.two" in Sources(root).closure(["d"])


def test_packages_beside_ours_are_followed_into_it_and_back(tmp_path):
    for name, text in {"lfportrait/__init__.py": "", "lfportrait/a.py": "from . import b\n",
                       "lfportrait/b.py": "", "lfportrait/c.py": "", "lab/__init__.py": "",
                       "lab/one.py": "from lfportrait.a import x\nfrom .two import y\n",
                       "lab/two.py": "", "lab/three.py": "",
                       "single.py": "import lab.two\n"}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    sources = Sources(tmp_path / "lfportrait", beside=(tmp_path / "lab", tmp_path / "single.py"))
    assert sources.closure(["lab.one"]) == {"lab.one", "lab.two", "lfportrait.a", "lfportrait.b"}
    assert sources.closure(["single"]) == {"single", "lab.two"}
    assert sources.closure(["c", "lab.three"]) == {"lfportrait.c", "lab.three"}


def test_a_key_may_name_modules_of_another_package():
    """What the laboratory makes is stale when its code changes, or ours that it imports."""
    keys = {name: cache.code_of(name) for name in (
        "stylize.optimize", "lfportrait_eval.tables.figures",
        "lfportrait_eval.baselines.field.methods")}
    assert len(set(keys.values())) == 3
    both = cache.code_of("stylize.optimize", "lfportrait_eval.baselines.field.methods")
    assert both not in keys.values()
    lab = cache._place("lfportrait_eval")
    found = Sources(Path(cache.__file__).parent, beside=(lab,)).closure([
        "lfportrait_eval.baselines.field.methods"])
    assert {"lfportrait_eval.baselines.field.arf", "lfportrait.stylize.losses"} <= found
    with pytest.raises(KeyError):
        cache.code_of("no_such_package.module")


def test_the_products_results_do_not_depend_on_the_laboratory():
    lab = cache._place("lfportrait_eval")
    sources = Sources(Path(cache.__file__).parent, beside=(lab,))
    for makers in MAKERS.values():
        assert not [name for name in sources.closure(makers) if name.startswith("lfportrait_eval")]


def test_the_imports_are_read_once(tmp_path, monkeypatch):
    (tmp_path / "lfportrait").mkdir()
    (tmp_path / "lfportrait" / "__init__.py").write_text("import json\n")
    (tmp_path / "lfportrait" / "a.py").write_text("A = 1\n")
    kept = Text().kept
    first = Sources(tmp_path / "lfportrait", kept).code_of(["a"])
    monkeypatch.setattr("lfportrait.sources.Sources._read", None)
    assert Sources(tmp_path / "lfportrait", kept).code_of(["a"]) == first
    monkeypatch.undo()
    (tmp_path / "lfportrait" / "a.py").write_text("A = 23\n")
    assert Sources(tmp_path / "lfportrait", kept).code_of(["a"]) != first


def test_the_users_cache_is_where_it_is_told_to_be(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache("masks") == tmp_path / "lfportrait" / "masks"


def test_what_is_only_tried_goes_with_the_next_try_unless_it_was_kept(tmp_path):
    def ask(key):
        kept_arrays("tries", key, lambda: {"x": np.zeros(2)}, tmp_path)

    def there():
        return {path.stem for path in tmp_path.glob("*.npz")}

    ask("always")
    with tried():
        ask("always")
        ask("first")
        ask("both")
    assert there() == {"always", "first", "both"}, "it may be saved: then it is read again"
    with tried():
        ask("both")
        ask("second")
    assert there() == {"always", "both", "second"}
    ask("second")  # it was saved
    for number in range(5):
        with tried():
            ask(f"another {number}")
    assert there() == {"always", "second", "another 4"}
