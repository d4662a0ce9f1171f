"""The plan of the house: the order of the stages, and which module imports which.

There are two packages: the product, `lfportrait`, and the laboratory beside it, `lfportrait_eval`,
which imports the product and is imported by nothing there.

The walk reads the sources as text (`ast`), so that imports in functions and type checks count, too.
"""

from __future__ import annotations

import ast
import functools
from pathlib import Path

__all__ = ["GROUND", "LABORATORY", "ORDER", "ROOMS", "ROOT", "SOURCE", "STAGES", "Graph", "circles",
           "graph_of", "imported", "laboratory_imports", "module_files", "place", "stage_imports",
           "without_detours"]

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "lfportrait"
LABORATORY = ROOT / "src" / "lfportrait_eval"

STAGES = ("capture", "field", "face", "example", "stylize", "lightfield", "share", "demo",
          "job", "studio", "cli")
"""In order: a stage imports only stages before it, and the ground floor."""
GROUND = ("arrays", "browsing", "cache", "color", "device", "errors",
          "files", "gpu", "graphics", "health", "labels", "measure",
          "media", "metrics", "models", "plugins", "png", "progress",
          "runner", "simd", "temporary", "version")
"""Carries all stages and knows none."""
ROOMS = ("markdown", "metrics", "baselines", "bench", "study", "tables", "commands")
"""Of the laboratory, in order: a room imports only rooms before it, and the product."""
ORDER = (*STAGES, *(f"{LABORATORY.name}.{room}" for room in ROOMS))
"""Stages and rooms: each imports only those before it."""

Graph = dict[str, set[str]]
"""What each module (or stage) imports."""


def module_files(source: Path = SOURCE, package: str = "") -> dict[str, Path]:
    """Path of each module by its dotted name; a package stands for its ``__init__.py``."""
    files = {}
    package = package or source.name
    for path in sorted(source.rglob("*.py")):
        parts = [package, *path.relative_to(source).with_suffix("").parts]
        files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return files


@functools.cache
def import_lines(path: Path) -> list[ast.Import | ast.ImportFrom]:
    """Imports of a module, and of the stub beside it, which says what a package loads lazily."""
    return [line for file in (path, path.with_suffix(".pyi")) if file.is_file()
            for line in imports_of(file)[0]]


@functools.cache
def imports_of(file: Path) -> tuple[list[ast.Import | ast.ImportFrom], ...]:
    """All imports of a file, and those at once (`imports_in`): to parse takes longest."""
    statements = ast.parse(file.read_text("utf-8")).body
    return imports_in(statements), imports_in(statements, at_once=True)


def imports_in(statements: list[ast.stmt], *, at_once: bool = False,
               ) -> list[ast.Import | ast.ImportFrom]:
    """Imports among statements and in what they hold.

    Those ``at_once`` are neither in functions nor for type checkers alone.
    """
    found: list[ast.Import | ast.ImportFrom] = []
    waiting: list[ast.stmt | ast.excepthandler | ast.match_case] = [*statements]
    while waiting:
        node = waiting.pop()
        if at_once and (isinstance(node, ast.FunctionDef) or (
                isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test))):
            continue
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            found.append(node)
        # Statements stand in statements alone: expressions are most of a tree, and are left out.
        for block in ("body", "orelse", "handlers", "finalbody", "cases"):
            waiting += getattr(node, block, ())
    return found


@functools.cache
def offered(path: Path) -> set[str]:
    """The names that a package's ``__init__.py`` takes from its modules: what stands outside."""
    return {alias.asname or alias.name for node in import_lines(path)
            if isinstance(node, ast.ImportFrom) for alias in node.names}


def home(base: str, name: str, files: dict[str, Path]) -> str:
    """The module that a package with a stub takes a name from when it is asked; else ``base``."""
    if base in files and files[base].with_suffix(".pyi").is_file():
        for node in import_lines(files[base]):
            if (isinstance(node, ast.ImportFrom) and node.level == 1 and node.module
                    and name in {alias.asname or alias.name for alias in node.names}):
                return home(f"{base}.{node.module}", name, files)
    return base


def imported(name: str, path: Path, files: dict[str, Path], *, asked: bool = False) -> set[str]:
    """The modules that a module imports anywhere in it, functions and type checks included.

    Where packages load their names when they are ``asked`` for them, these lead to the modules that
    have them; else to the package, and from it to all that it offers.
    """
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found: set[str] = set()
    for node in [] if asked and path.with_suffix(".pyi").is_file() else import_lines(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names} & set(files)
        else:
            base = node.module or ""
            if node.level:
                above = package.split(".")[:len(package.split(".")) - node.level + 1]
                base = ".".join(above + ([node.module] if node.module else []))
            # A package's function may have its module's name: then the function is meant.
            names = offered(files[base]) if base in files and base != package else set()
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                found |= ({inner} if inner in files and alias.name not in names
                          else {home(base, alias.name, files) if asked else base} & set(files))
    return found - {name}


def graph_of(files: dict[str, Path], *, asked: bool = False) -> Graph:
    """The imports of all modules (`imported`)."""
    return {name: imported(name, path, files, asked=asked) for name, path in files.items()}


def circles(graph: Graph) -> list[list[str]]:
    """Groups of modules that import each other in a loop (Tarjan's components)."""
    number: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(name: str) -> None:
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


def place(name: str) -> str:
    """The stage or the ground-floor module that a module belongs to; empty for the package.

    In the laboratory: the room, with the package's name before it.
    """
    parts = name.split(".")
    return ".".join(parts[:2] if parts[0] == LABORATORY.name else parts[1:2])


def stage_imports(graph: Graph) -> Graph:
    """Which stages a stage imports."""
    found: Graph = {stage: set() for stage in STAGES}
    for name, others in graph.items():
        if place(name) in found:
            found[place(name)] |= {place(other) for other in others} & set(STAGES) - {place(name)}
    return found


def laboratory_imports(graph: Graph) -> set[str]:
    """Which stages the laboratory imports."""
    return {place(other) for name, others in graph.items()
            if name.partition(".")[0] == LABORATORY.name for other in others} & set(STAGES)


def without_detours(graph: Graph) -> Graph:
    """The graph without the arrows that a longer way implies (transitive reduction)."""
    def reached(name: str) -> set[str]:
        return set().union(*({other} | reached(other) for other in graph[name]))

    return {name: {other for other in others
                   if not any(other in reached(middle) for middle in others - {other})}
            for name, others in graph.items()}
