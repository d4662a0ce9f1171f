"""The page of parameters follows from the configuration classes; pages name what is there."""

import dataclasses
import importlib.util
import re
from pathlib import Path
from typing import Literal

import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def make_docs():
    spec = importlib.util.spec_from_file_location("make_docs", ROOT / "scripts" / "make_docs.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_committed_page_is_up_to_date(make_docs):
    page = ROOT / "docs" / "parameters.md"
    assert page.read_text("utf-8") == make_docs.page(), "run python scripts/make_docs.py"


def test_every_parameter_has_a_meaning(make_docs):
    for _, config, _ in make_docs.SECTIONS:
        docs = make_docs.field_docs(config)
        for entry in dataclasses.fields(config):
            assert len(docs.get(entry.name, "")) > 5, f"{config.__name__}.{entry.name}"
    docs = make_docs.attribute_docs(make_docs.Display)
    assert all(docs.get(entry.name) for entry in dataclasses.fields(make_docs.Display))


@dataclasses.dataclass
class Sample:
    """A sample."""

    kind: "Literal['a', 'b']" = "a"
    """Which | one.
    Two lines."""
    size: tuple[int, ...] = (1, 2)
    """How large."""
    quiet: bool = False
    """Whether."""
    weight: float = 1e-5
    """How much."""


def test_rows_show_default_choices_and_meaning(make_docs):
    text = "\n".join(make_docs.rows_of(Sample, make_docs.field_docs(Sample), True))
    assert "| `--kind` | `a` | One of `a`, `b`. Which \\| one. Two lines. |" in text
    assert "| `--size` | `1 2` | How large. |" in text
    assert "| `--quiet` | `no` | Whether. |" in text and "`1e-05`" in text


PAGES = ["CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", *(path.relative_to(ROOT).as_posix()
                               for path in sorted((ROOT / "docs").rglob("*.md")))]


def targets(text):
    """Where the links of a page lead, those to other sites left out."""
    return [target for target in re.findall(r"\]\(([^)#]+)\)", text) if "://" not in target]


@pytest.mark.parametrize("page", ["README.md", *PAGES])
def test_links_lead_somewhere(page):
    for target in targets((ROOT / page).read_text("utf-8")):
        assert ((ROOT / page).parent / target).exists(), target


def test_the_readme_is_short_and_begins_with_a_moving_picture():
    text = (ROOT / "README.md").read_text("utf-8")
    assert len(text.splitlines()) <= 120
    with Image.open(ROOT / re.search(r"!\[[^\]]*\]\(([^)]+)\)", text)[1]) as picture:
        assert picture.n_frames > 1


def missing(text):
    """Folders and modules that are named as code or by a link, but are not here."""
    packages = [ROOT / "src" / "lfportrait", ROOT / "src" / "lfportrait_eval"]
    places = [ROOT, ROOT / "src", *packages,
              *(path for source in packages for path in source.iterdir() if path.is_dir())]
    names = re.findall(r"[`[]((?:[a-z_0-9]+/)+(?:[a-z_0-9]+\.py)?|[a-z_0-9]+\.py)[`\]]", text)
    return [name for name in names if not any((place / name).exists() for place in places)]


@pytest.mark.parametrize("page", PAGES)
def test_pages_name_files_that_exist(page):
    assert missing((ROOT / page).read_text("utf-8")) == []


def test_wrong_names_are_found():
    text = "`field/kernels/march.py` `kernels/` `field/` `models.py` `field/kernels/`"
    assert missing(text) == []
    assert missing("`field/march.py` `commands/` `cli.py` [a/b.py](c.md)") == [
        "field/march.py", "commands/", "cli.py", "a/b.py"]
