"""The pages' scripts are clean, and what checks it finds what is not."""

import pytest

from lint_page import lint, pages


@pytest.mark.parametrize("name", ["portrait", "study"])
def test_the_script_and_the_style_are_clean(name):
    well, told = lint(*pages()[name])
    assert well, told


@pytest.mark.parametrize(("slip", "rule"), [
    ("console.log(nobody);", "noUndeclaredVariables"), ("const spare = 1;", "noUnusedVariables"),
    ("var old = 1; console.log(old);", "noVar"),
    ("if (1 == '1') console.log(1);", "noDoubleEquals"), ("function (", "parse")])
def test_slips_are_found(slip, rule):
    well, told = lint(f"(() => {{ {slip} }})();\n")
    assert not well and rule in told
