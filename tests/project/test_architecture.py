"""The house keeps its order: imports run one way, between stages and between files."""

import ast
import warnings

import pytest

from house import GROUND, ROOT, SOURCE, STAGES, circles, graph_of, imported, module_files, place

FILES = module_files()
GRAPH = graph_of(FILES)


def test_no_files_import_each_other_in_a_circle():
    assert circles(GRAPH) == []


class _AtOnce(ast.NodeTransformer):
    """A module without what it imports later: in functions, or for type checkers alone."""

    def visit_FunctionDef(self, node):
        return ast.Pass()

    def visit_If(self, node):
        return ast.Pass() if "TYPE_CHECKING" in ast.dump(node.test) else node


def test_modules_can_be_imported_in_any_order(tmp_path):
    """No circles either through packages: one of a package's modules imports all of the package."""
    graph = {}
    for name, path in FILES.items():
        tree = _AtOnce().visit(ast.parse(path.read_text("utf-8")))
        (tmp_path / path.name).write_text(ast.unparse(tree))
        others = imported(name, tmp_path / path.name, FILES)
        doors = {".".join(other.split(".")[:depth]) for other in others
                 for depth in range(1, other.count(".") + 1)}
        graph[name] = others | {door for door in doors & set(FILES)
                                if not f"{name}.".startswith(f"{door}.")}
    assert circles(graph) == []


def test_every_folder_is_a_stage_or_on_the_ground_floor():
    places = {place(name) for name in FILES} - {"", "__main__"}
    assert places == {*STAGES, *GROUND}


def test_a_stage_imports_only_stages_before_it():
    wrong = [f"{name} imports {other}" for name, others in GRAPH.items() for other in others
             if place(name) in STAGES and place(other) in STAGES
             and STAGES.index(place(other)) > STAGES.index(place(name))]
    assert wrong == []


def test_the_ground_floor_knows_no_stage():
    wrong = [f"{name} imports {other}" for name, others in GRAPH.items() for other in others
             if place(name) in GROUND and place(other) in STAGES]
    assert wrong == []


def test_a_stage_is_entered_by_a_front_door():
    """From elsewhere only packages are imported: what an ``__init__.py`` names is public."""
    wrong = [f"{name} imports {other}" for name, others in GRAPH.items() for other in others
             if place(name) in STAGES and place(other) in STAGES and place(other) != place(name)
             and FILES[other].name != "__init__.py" and other != "lfportrait.field.marching"]
    assert wrong == []


def test_hot_loops_belong_to_their_stage():
    wrong = [f"{name} imports {other}" for name, others in GRAPH.items() for other in others
             if ".kernels" in other and place(other) != place(name)]
    assert wrong == []


def test_rooms_can_be_overlooked():
    """Large files and folders are warned of: a room follows an idea, not a number."""
    rooms = {}
    for path in SOURCE.rglob("*.py"):
        rooms.setdefault(path.parent, []).append(path)
        lines = len(path.read_text("utf-8").splitlines())
        if lines > 420:
            warnings.warn(f"{path.relative_to(ROOT)} has {lines} lines", stacklevel=1)
    for room, files in rooms.items():
        if len(files) > 16:
            warnings.warn(f"{room.relative_to(ROOT)} has {len(files)} files", stacklevel=1)


def test_tests_mirror_the_folders():
    folders = {path.parent.relative_to(ROOT / "tests").parts
               for path in (ROOT / "tests").rglob("test_*.py")}
    # Tests of the project itself: documents, examples, scripts, this file.
    unknown = [parts for parts in folders - {(), ("project",)}
               if not SOURCE.joinpath(*parts).is_dir()]
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
