"""The pages' scripts are clean, and what checks it finds what is not."""

import pytest

from lint_page import ROOT, lint, lint_modules, missing_imports, pages


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


def test_the_modules_of_the_studio_are_clean():
    well, told = lint_modules(ROOT / "src" / "lfportrait" / "studio" / "web")
    assert well, told


def test_a_name_that_no_module_exports_is_found(tmp_path):
    (tmp_path / "one.js").write_text("export const here = 1;\n")
    (tmp_path / "two.js").write_text('import { here, gone } from "./one.js";\nhere(gone);\n')
    assert missing_imports(tmp_path) == ["two.js: ./one.js has no gone"]
    assert not lint_modules(tmp_path)[0]
