"""What the package must hold; `scripts/try_package.py` builds it and runs it."""

import importlib
import itertools
import tomllib
import zipfile
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import try_package
from lfportrait.cli import COMMANDS
from try_package import ROOT, contents, same

PACKAGES = ROOT / "src" / "lfportrait", ROOT / "src" / "lfportrait_eval"
PROJECTS = [tomllib.loads(path.read_text("utf-8"))
            for path in (ROOT / "pyproject.toml", PACKAGES[1] / "pyproject.toml")]
SOURCES = [path for package in PACKAGES for path in package.rglob("*")
           if path.is_file() and path.name != "pyproject.toml"
           and not any(part == "__pycache__" or part.endswith(".egg-info") for part in path.parts)]


def test_every_folder_of_sources_is_a_package():
    folders = {path.parent for path in SOURCES if path.suffix == ".py"}
    assert [folder for folder in folders if not (folder / "__init__.py").is_file()] == []


def test_every_file_that_is_no_source_is_named_as_data():
    named = {path for package, project in zip(PACKAGES, PROJECTS)
             for pattern in project["tool"]["setuptools"]["package-data"][package.name]
             for path in package.glob(pattern)}
    assert [path for path in SOURCES if path.suffix != ".py" and path not in named] == []
    assert {package / "py.typed" for package in PACKAGES} <= named


def test_the_command_line_knows_the_commands_of_both_packages():
    """Those of the laboratory are written down there as the entry points name them."""
    commands = PROJECTS[1]["project"]["entry-points"]["lfportrait.commands"]
    named = {name.replace(".", " "): place for name, place in commands.items()}
    assert named == {name: f"{module}:{kind}" for name, (module, kind, _) in COMMANDS.items()
                     if "." in module}


def test_the_installation_has_the_entry_points_of_the_project():
    """Else commands and methods of the laboratory are not found: install again."""
    for project in PROJECTS:
        for group, named in project["project"]["entry-points"].items():
            found = {entry.name: entry.value for entry in entry_points(group=group)}
            assert named.items() <= found.items(), (
                "pyproject.toml changed: pip install -e '.[dev]' -e src/lfportrait_eval")


def test_what_the_entry_points_name_is_there():
    for project in PROJECTS:
        for group in project["project"]["entry-points"].values():
            for place in group.values():
                module, _, name = place.partition(":")
                assert hasattr(importlib.import_module(module), name), place


def test_the_evaluation_package_names_all_of_its_folders_and_wants_this_version():
    product, evaluation = PROJECTS
    folders = {".".join(path.parent.relative_to(PACKAGES[1].parent).parts)
               for path in SOURCES if path.is_relative_to(PACKAGES[1])}
    assert set(evaluation["tool"]["setuptools"]["packages"]) == folders
    version = product["project"]["version"]
    assert evaluation["project"]["version"] == version
    assert f"lfportrait=={version}" in evaluation["project"]["dependencies"]
    # What users install does not bring it.
    assert not any("eval" in text for text in product["project"]["dependencies"])


def test_the_pinned_versions_are_allowed_ones():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    pinned = dict(line.split("==") for line in
                  (ROOT / "constraints.txt").read_text("utf-8").split())
    pinned = {canonicalize_name(name): version for name, version in pinned.items()}
    extras = project["optional-dependencies"].values()
    others = [text for text in PROJECTS[1]["project"]["dependencies"]
              if Requirement(text).name != "lfportrait"]
    for text in itertools.chain(project["dependencies"], others, *extras):
        wanted = Requirement(text)
        assert wanted.specifier.contains(pinned[canonicalize_name(wanted.name)]), text
    # Its private parts may change with each minor version.
    numba = next(text for text in project["dependencies"] if text.startswith("numba"))
    major, minor, _ = pinned["numba"].split(".")
    assert not Requirement(numba).specifier.contains(f"{major}.{int(minor) + 1}")


def test_git_knows_what_the_package_is_made_of():
    known = set(try_package.tracked("src"))
    if not known:
        pytest.skip("no checkout of git's")
    assert {str(path.relative_to(ROOT).as_posix()) for path in SOURCES
            if path.suffix in (".pyi", ".toml", ".html", ".css", ".js", ".glsl",
                               ".safetensors")} <= known


def test_what_differs_is_told():
    same({"a": b"1"}, {"a": b"1"}, "both")
    with pytest.raises(SystemExit, match="both differ in: b, c, d"):
        same({"a": b"1", "b": b"2", "c": b"3"}, {"a": b"1", "b": b"9", "d": b"4"}, "both")


def test_a_wheels_contents_are_the_packages_files(tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "some.whl", "w") as archive:
        archive.writestr("some/__init__.py", "x = 1")
        archive.writestr("some-1.0.dist-info/RECORD", "")
    assert contents(tmp_path / "some.whl") == {"some/__init__.py": b"x = 1"}
