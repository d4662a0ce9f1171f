"""The house keeps its order: imports run one way, between stages and between files."""

import re
from pathlib import Path

import pytest

import house
from house import (
    GROUND,
    LABORATORY,
    ORDER,
    ROOMS,
    ROOT,
    SOURCE,
    STAGES,
    circles,
    graph_of,
    import_lines,
    imported,
    imports_of,
    laboratory_imports,
    module_files,
    place,
)

PRODUCT = module_files()
FILES = {**PRODUCT, **module_files(LABORATORY)}


@pytest.fixture(scope="module")
def graph():
    """All imports, which take a second to find: not for those that only collect these tests."""
    return graph_of(FILES)


def test_no_files_import_each_other_in_a_circle(graph):
    assert circles(graph) == []


def test_modules_can_be_imported_in_any_order(monkeypatch):
    """No circles either through packages: one of a package's modules imports all of the package."""
    graph, alone = {}, {}
    monkeypatch.setattr(house, "import_lines",
                        lambda path: alone[path] if path in alone else import_lines(path))
    for name, path in FILES.items():
        place = Path(name) / path.name  # nowhere: what is read of a file is kept under its path
        alone[place] = imports_of(path)[1]
        others = imported(name, place, FILES)
        doors = {".".join(other.split(".")[:depth]) for other in others
                 for depth in range(1, other.count(".") + 1)}
        graph[name] = others | {door for door in doors & set(FILES)
                                if not f"{name}.".startswith(f"{door}.")}
    assert circles(graph) == []


def test_every_folder_is_a_stage_or_on_the_ground_floor():
    places = {place(name) for name in PRODUCT} - {"", "__main__"}
    assert places == {*STAGES, *GROUND}


def test_every_folder_of_the_laboratory_is_a_room():
    places = {place(name) for name in FILES.keys() - PRODUCT.keys()}
    assert places == {LABORATORY.name, *(f"{LABORATORY.name}.{room}" for room in ROOMS)}


def test_nothing_in_the_product_imports_the_laboratory(graph):
    wrong = [f"{name} imports {other}" for name in PRODUCT for other in graph[name]
             if other not in PRODUCT]
    assert wrong == []
    assert laboratory_imports(graph) and not laboratory_imports({n: graph[n] for n in PRODUCT})


def test_a_stage_imports_only_stages_before_it(graph):
    wrong = [f"{name} imports {other}" for name, others in graph.items() for other in others
             if place(name) in ORDER and place(other) in ORDER
             and ORDER.index(place(other)) > ORDER.index(place(name))]
    assert wrong == []


def test_the_ground_floor_knows_no_stage(graph):
    wrong = [f"{name} imports {other}" for name, others in graph.items() for other in others
             if place(name) in GROUND and place(other) in STAGES]
    assert wrong == []


def test_a_stage_is_entered_by_a_front_door(graph):
    """From elsewhere only packages are imported: what an ``__init__.py`` names is public.

    The rooms of the laboratory are open to each other. The baselines are made of the same parts as
    our methods, and take these from their modules.
    """
    def open_to(name, other):
        baseline = place(name) == f"{LABORATORY.name}.baselines"
        return (other == "lfportrait.field.marching" or other not in PRODUCT
                or (baseline and place(other) in ("example", "stylize")))

    wrong = [f"{name} imports {other}" for name, others in graph.items() for other in others
             if place(name) in ORDER and place(other) in ORDER and place(other) != place(name)
             and FILES[other].name != "__init__.py" and not open_to(name, other)]
    assert wrong == []


def test_lists_of_public_names_stand_in_packages_alone():
    wrong = [name for name, path in FILES.items() if path.name != "__init__.py"
             and name != "lfportrait.field.marching"  # what it lists is imported there for others
             and re.search(r"^__all__\b", path.read_text("utf-8"), re.M)]
    assert wrong == []


def test_hot_loops_belong_to_their_stage(graph):
    wrong = [f"{name} imports {other}" for name, others in graph.items() for other in others
             if ".kernels" in other and place(other) != place(name)]
    assert wrong == []


def test_tests_mirror_the_folders():
    folders = {path.parent.relative_to(ROOT / "tests").parts
               for path in (ROOT / "tests").rglob("test_*.py")}
    # Tests of the project itself: documents, examples, scripts, this file.
    unknown = [parts for parts in folders - {(), ("project",)}
               if not (SOURCE.parent if parts[0] == LABORATORY.name else SOURCE
                       ).joinpath(*parts).is_dir()]
    assert unknown == []


@pytest.mark.parametrize("text, wrong", [
    ("from ..b.two import x", True),
    ("def f():\n    from ..b import two", True),
    ("if TYPE_CHECKING:\n    import pack.b.two", True),
    ("import numpy", False)])
def test_the_walk_finds_circles_wherever_the_import_stands(tmp_path, text, wrong):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "__init__.py").write_text("")
    (tmp_path / "a" / "one.py").write_text(text)
    (tmp_path / "b" / "two.py").write_text("from ..a import one")
    found = circles(graph_of(module_files(tmp_path, "pack")))
    assert found == ([["pack.a.one", "pack.b.two"]] if wrong else [])
