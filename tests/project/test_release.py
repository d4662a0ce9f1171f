"""What people expect of a project that they may join says the same everywhere."""

import re
import tomllib
from pathlib import Path

import yaml

import lfportrait

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def test_one_version_everywhere():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))["version"]
    changes = re.findall(r"^## \[([\d.]+)\]", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M)
    assert PROJECT["version"] == lfportrait.__version__ == cited == changes[0]


def test_the_changelog_has_the_usual_form():
    """Keep a Changelog: the newest first, and six kinds of changes."""
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    headings = re.findall(r"^## \[(.+)\]", text, re.M)
    assert headings[0] == "Unreleased"
    versions = [tuple(map(int, heading.split("."))) for heading in headings[1:]]
    assert versions == sorted(versions, reverse=True)
    assert set(re.findall(r"^### (.+)$", text, re.M)) <= {
        "Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_the_citation_names_the_paper_of_the_project_s_link():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert cited["license"] == PROJECT["license"] and cited["title"] == PROJECT["name"]
    assert PROJECT["urls"]["Paper"].endswith(cited["references"][0]["doi"])


def test_the_workflow_tests_the_versions_that_the_package_promises():
    jobs = yaml.safe_load((ROOT / ".github/workflows/tests.yml").read_text("utf-8"))["jobs"]
    matrix = jobs["tests"]["strategy"]["matrix"]
    promised = [kind.rpartition(" ")[2] for kind in PROJECT["classifiers"]
                if "Python :: 3." in kind]
    assert matrix["python"] == promised
    assert PROJECT["requires-python"] == f">={promised[0]}"
    assert [system.partition("-")[0] for system in matrix["system"]] == [
        "ubuntu", "macos", "windows"]


def test_templates_of_issues_are_readable():
    for path in sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("[!c]*.yml")):
        form = yaml.safe_load(path.read_text("utf-8"))
        assert form["name"] and form["description"]
        names = [part["id"] for part in form["body"]]
        assert len(names) == len(set(names)) and names
