"""The page on the paper names code that is there, and leaves out nothing that has a number."""

import ast
import re
from pathlib import Path

import pytest

from house import ROOT

PAGE = ROOT / "docs" / "paper.md"
NUMBERED = ([f"Eq. {n}" for n in range(1, 10)] + [f"Fig. {n}" for n in range(1, 9)]
            + [f"Table {n}" for n in (1, 2)])


def defined(path: Path) -> set[str]:
    """Functions and classes of a module, methods as ``Class.method``."""
    kinds = ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef
    body = [node for node in ast.parse(path.read_text("utf-8")).body if isinstance(node, kinds)]
    return {node.name for node in body} | {
        f"{node.name}.{inner.name}" for node in body if isinstance(node, ast.ClassDef)
        for inner in node.body if isinstance(inner, kinds)}


def mistakes(text: str, folder: Path = PAGE.parent) -> list[str]:
    """Links that lead nowhere; names in back quotes that the linked file before them lacks."""
    found = []
    for cell in re.split(r"\n|\|", text):
        known, linked = None, ""
        for target, name in re.findall(r"\[[^]]*\]\(([^)#]+)\)|`([^`]+)`", cell):
            path = folder / (target or linked)
            if target:
                linked, known = target, None
                if not path.is_file():
                    found.append(f"no file {target}")
                elif path.suffix == ".py":
                    known = defined(path)
            elif known is not None and name not in known:
                found.append(f"no {name} in {linked}")
    return found


def rows(text: str) -> dict[str, list[str]]:
    """The cells of each row by its first."""
    table = [[cell.strip() for cell in line.strip("| \n").split("|")]
             for line in text.splitlines() if re.match(r"\| [A-Z]", line)]
    assert len({row[0] for row in table}) == len(table)
    return {row[0]: row[1:] for row in table}


def test_every_link_and_name_of_the_page_is_there():
    assert mistakes(PAGE.read_text("utf-8")) == []


def test_everything_with_a_number_has_its_row():
    found = rows(PAGE.read_text("utf-8"))
    assert [name for name in found if re.match(r"(Eq\.|Fig\.|Table) ", name)] == NUMBERED
    for name in NUMBERED:
        says, where, otherwise = found[name]
        assert says and otherwise and (".py)" in where or "not yet" in where), name


def test_a_file_says_which_equation_it_implements():
    """The number of each equation stands in a linked file, too."""
    for name in NUMBERED[:9]:
        targets = re.findall(r"\]\(([^)]+\.py)\)", rows(PAGE.read_text("utf-8"))[name][1])
        number = name.removeprefix("Eq. ")
        assert any(re.search(rf"Eq\.[^.]*\b{number}\b", (PAGE.parent / target).read_text("utf-8"))
                   for target in targets), name


CODE = "[`march.py`](../src/lfportrait/field/kernels/march.py)"
SHOWN = "[`display.py`](../src/lfportrait/lightfield/display.py)"


@pytest.mark.parametrize("text, wrong", [
    (f"| Eq. 1 | {CODE} `make_march` | `--option` |", []),
    (f"{SHOWN} `Display.phase`, `Display`", []),
    (f"{CODE} `make_march`, `make_marsh`",
     ["no make_marsh in ../src/lfportrait/field/kernels/march.py"]),
    (f"{CODE} `make_march`; {SHOWN} `make_march`",
     ["no make_march in ../src/lfportrait/lightfield/display.py"]),
    (f"{SHOWN} `phase`", ["no phase in ../src/lfportrait/lightfield/display.py"]),
    ("[`gone.py`](../src/lfportrait/gone.py) `anything`", ["no file ../src/lfportrait/gone.py"]),
    ("[methods](methods.md) `anything`", [])])
def test_the_check_finds_wrong_names(text, wrong):
    assert mistakes(text) == wrong
