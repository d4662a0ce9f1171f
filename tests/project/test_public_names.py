"""The public surface is what examples and documents use; it is typed and documented."""

import dataclasses
import inspect
import re
from pathlib import Path

import pytest

import lfportrait as lf

ROOT = Path(__file__).parents[2]
NAMES = [name for name in lf.__all__ if name != "__version__"]
PROGRAMS = [*(ROOT / "examples").glob("*.py"), ROOT / "README.md",
            *(path for path in (ROOT / "docs").glob("*.md"))]


def thing_of(name):
    """What a name stands for; a stage may stand for its function."""
    thing = getattr(lf, name)
    return getattr(thing, name) if inspect.ismodule(thing) else thing


def parameters_of(function):
    """Parameters that a caller gives by name or place."""
    return [one for one in inspect.signature(function).parameters.values()
            if one.name not in ("self", "cls")]


def test_what_examples_and_documents_use_is_public_and_the_other_way_round():
    used = {name for path in PROGRAMS
            for name in re.findall(r"\blf\.(\w+)", path.read_text("utf-8"))}
    assert used == set(NAMES)


def test_the_list_is_in_order():
    assert lf.__all__ == sorted(lf.__all__)


@pytest.mark.parametrize("name", NAMES)
def test_public_names_have_types(name):
    thing = thing_of(name)
    if inspect.isclass(thing):
        functions = [entry for key, entry in inspect.getmembers(thing, inspect.isroutine)
                     if not key.startswith("_")
                     and "lfportrait" in str(getattr(entry, "__module__", ""))]
        if dataclasses.is_dataclass(thing):
            assert all(field.type is not None for field in dataclasses.fields(thing))
    else:
        functions = [thing]
    for function in functions:
        signature = inspect.signature(function)
        assert signature.return_annotation is not inspect.Signature.empty, function
        assert [one.name for one in parameters_of(function)
                if one.annotation is inspect.Parameter.empty] == [], function


@pytest.mark.parametrize("name", NAMES)
def test_public_names_are_documented(name):
    thing = thing_of(name)
    text = inspect.getdoc(thing) or ""
    assert text[:1].isupper() and text.partition("\n")[0].rstrip()[-1] in ".:,", name
    if inspect.isfunction(thing) and len(parameters_of(thing)) > 1:
        assert "Parameters\n---" in text, name
        listed = text.partition("Parameters\n---")[2]
        assert [one.name for one in parameters_of(thing)
                if not re.search(rf"^[\w, ]*\b{one.name}\b", listed, re.M)] == [], name
