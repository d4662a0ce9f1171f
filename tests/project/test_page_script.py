"""The page's script is clean, and what checks it finds what is not."""

import pytest

from lfportrait.share import page_script
from lint_page import lint


def test_the_script_and_the_style_are_clean():
    from importlib import resources

    style = resources.files("lfportrait.share.page") / "web" / "page.css"
    well, told = lint(page_script(), style.read_text("utf-8"))
    assert well, told


@pytest.mark.parametrize(("slip", "rule"), [
    ("console.log(nobody);", "noUndeclaredVariables"), ("const spare = 1;", "noUnusedVariables"),
    ("var old = 1; console.log(old);", "noVar"),
    ("if (1 == '1') console.log(1);", "noDoubleEquals"), ("function (", "parse")])
def test_slips_are_found(slip, rule):
    well, told = lint(f"(() => {{ {slip} }})();\n")
    assert not well and rule in told
