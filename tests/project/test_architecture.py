"""The house keeps its order: imports run one way, between stages and between files."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "lfportrait"

STAGES = ("capture", "field", "face", "example", "stylize", "lightfield", "share", "demo",
          "evaluate", "job", "cli")
"""In order: a stage imports only stages before it, and the ground floor."""
GROUND = ("download", "errors", "files", "keys", "lanes", "measure", "metrics", "models",
          "progress")
"""Carries all stages and knows none."""


def module_files(source=SOURCE, package="lfportrait"):
    """Path of each module by its dotted name; a package stands for its ``__init__.py``."""
    files = {}
    for path in source.rglob("*.py"):
        parts = [package, *path.relative_to(source).with_suffix("").parts]
        files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return files


def offered(path):
    """The names that a package's ``__init__.py`` takes from its modules: what stands outside."""
    return {alias.asname or alias.name for node in ast.parse(path.read_text("utf-8")).body
            if isinstance(node, ast.ImportFrom) for alias in node.names}


def imported(name, path, files):
    """The modules that a module imports anywhere in it, functions and type checks included."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names} & set(files)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[:len(package.split(".")) - node.level + 1]
                base = ".".join(above + ([node.module] if node.module else []))
            # A package's function may have its module's name: then the function is meant.
            names = offered(files[base]) if base in files and base != package else set()
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                found |= ({inner} if inner in files and alias.name not in names
                          else {base} & set(files))
    return found - {name}


def graph_of(files):
    return {name: imported(name, path, files) for name, path in files.items()}


def circles(graph):
    """Groups of modules that import each other in a loop (Tarjan's components)."""
    number, low, stack, found = {}, {}, [], []

    def visit(name):
        number[name] = low[name] = len(number)
        stack.append(name)
        for other in graph[name]:
            if other not in number:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == number[name]:
            group = stack[stack.index(name):]
            del stack[stack.index(name):]
            if len(group) > 1:
                found.append(sorted(group))

    for name in graph:
        if name not in number:
            visit(name)
    return found


def place(name):
    """The stage or the ground-floor module that a module belongs to; empty for the package."""
    return name.split(".")[1] if "." in name else ""


FILES = module_files()
GRAPH = graph_of(FILES)


def test_no_files_import_each_other_in_a_circle():
    assert circles(GRAPH) == []


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
    rooms = {}
    for path in SOURCE.rglob("*.py"):
        rooms.setdefault(path.parent, []).append(path)
        assert len(path.read_text("utf-8").splitlines()) <= 420, path
    crowded = {str(room.relative_to(ROOT)): len(files) for room, files in rooms.items()
               if len(files) > 16}
    assert crowded == {}


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
