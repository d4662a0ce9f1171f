"""Measure the house: lines, files, parameters, import chains, and the rooms that data pass through.

Photos, an exemplar and a display are each followed through the program on the demo's small head:
every call into one of the package's files is noted, and what is counted are the folders (rooms)
that are entered and how often the way changes from one to another.

Run: python scripts/measure_house.py              this checkout
     python scripts/measure_house.py --json FILE  the figures as JSON, to compare two states
"""

from __future__ import annotations

import argparse
import ast
import dataclasses
import json
import sys
import tempfile
import threading
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import house

__all__ = ["crowded", "deepest_chain", "figures", "options", "rooms_entered"]

PACKAGES = tuple(path for path in sorted((house.ROOT / "src").iterdir())
                 if (path / "__init__.py").is_file())


def rooms_entered(work: Callable[[], Any]) -> tuple[list[str], int]:
    """The rooms that a function's calls enter, in their order, and how often the room changes."""
    order: dict[str, None] = {}
    changes, last = 0, ""
    places = [str(package.parent) + "/" for package in PACKAGES[:1]]

    def note(frame: Any, event: str, _: Any) -> None:
        nonlocal changes, last
        name = frame.f_code.co_filename
        if event != "call" or not name.startswith(places[0]):
            return
        room = name[len(places[0]):].rpartition("/")[0]
        if room != last:
            changes, last = changes + 1, room
            order.setdefault(room)

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # type: ignore[arg-type]
    return list(order), changes


def deepest_chain(graph: house.Graph) -> list[str]:
    """The longest way along imports, each module once."""
    known: dict[str, list[str]] = {}

    def longest(name: str) -> list[str]:
        if name not in known:
            known[name] = []  # a circle ends here
            below = [longest(other) for other in sorted(graph[name]) if other in graph]
            known[name] = [name, *max(below, key=len, default=[])]
        return known[name]

    return max((longest(name) for name in sorted(graph)), key=len)


def statements(tree: ast.AST) -> Iterator[ast.AST]:
    """A tree and all statements and handlers in it: expressions hold no functions by name."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            waiting += getattr(node, part, ())


def crowded(most: int = 8, package: Path = PACKAGES[0]) -> list[str]:
    """Functions of a package outside kernels that take more parameters than ``most``.

    ``self`` and ``cls`` do not count.
    """
    found = []
    for path in sorted(package.rglob("*.py")):
        if "kernels" in path.parts or path.stem == "kernels":
            continue
        for node in statements(ast.parse(path.read_text("utf-8"))):
            if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) or any(
                    "kernel" in ast.dump(one) for one in node.decorator_list):
                continue
            given = node.args
            names = [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
            if len(names) - (names[:1] in (["self"], ["cls"])) > most:
                found.append(f"{path.relative_to(package).as_posix()} {node.name}")
    return found


def options() -> int:
    """Parameters that users can set: fields of configuration classes and of commands, each once.

    Of the product; a field that holds another of these classes does not count, its fields do.
    """
    from lfportrait.cli.dispatch import COMMANDS, _command_class
    from lfportrait.share.kinds import own_exports

    waiting: list[Any] = [*map(_command_class, COMMANDS),
                          *(kind.parameters for kind in own_exports())]
    known: set[Any] = set()
    count = 0
    while waiting:
        one = waiting.pop()
        if one in known or one.__module__.partition(".")[0] != "lfportrait":
            continue
        known.add(one)
        waiting += [base for base in one.__bases__ if dataclasses.is_dataclass(base)]
        types = typing.get_type_hints(one)
        for name in vars(one).get("__annotations__", {}):
            inner = [kind for kind in (types[name], *typing.get_args(types[name]))
                     if dataclasses.is_dataclass(kind)]
            waiting += inner
            count += not inner and name in {field.name for field in dataclasses.fields(one)}
    return count


def _ways() -> dict[str, Callable[[], Any]]:
    """What is followed: each a function, its inputs made beforehand."""
    from lfportrait import Display, Skin, encode
    from lfportrait.demo import demo_capture, demo_exemplar, demo_head
    from lfportrait.example import SkinPainter
    from lfportrait.job import prepare_capture

    field, capture, exemplar = demo_head(), demo_capture(64, 6), demo_exemplar("fauve")
    assert capture.landmarks is not None
    skin = Skin.of(field, capture.landmarks, capture.cameras, 48.0)
    folder = Path(tempfile.mkdtemp())
    capture.save(folder / "capture")
    from lfportrait.capture import CalibrateConfig

    return {"photos": lambda: prepare_capture(folder / "capture", CalibrateConfig(),
                                              keep_background=True, need_face=False),
            "exemplar": lambda: SkinPainter(exemplar).paint(skin),
            "display": lambda: encode(field, Display.preset("generic-1080p"))}


def figures() -> dict[str, Any]:
    """All of it."""
    files = [path for package in PACKAGES for path in package.rglob("*.py")]
    product = [path for path in files if path.is_relative_to(PACKAGES[0])]
    modules = house.module_files(PACKAGES[0])
    graph, loaded = house.graph_of(modules), house.graph_of(modules, asked=True)
    found: dict[str, Any] = {
        "files": len(files), "lines": sum(len(path.read_text("utf-8").splitlines())
                                          for path in files),
        "product_files": len(product), "product_lines": sum(
            len(path.read_text("utf-8").splitlines()) for path in product),
        "crowded": crowded(), "options": options(),
        "deepest_chain": deepest_chain(graph), "deepest_chain_loaded": deepest_chain(loaded)}
    for name, work in _ways().items():
        rooms, changes = rooms_entered(work)
        found[name] = {"rooms": rooms, "changes": changes}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found = figures()
    if given.json is not None:
        given.json.write_text(json.dumps(found, indent=1), "utf-8")
    print(f"files                {found['files']}, of the product {found['product_files']}")
    print(f"lines                {found['lines']}, of the product {found['product_lines']}")
    print(f"more than 8 parameters {len(found['crowded'])}: {', '.join(found['crowded'])}")
    print(f"options              {found['options']}")
    print(f"deepest import chain {len(found['deepest_chain'])}, of modules as Python loads them "
          f"{len(found['deepest_chain_loaded'])}")
    for name in ("photos", "exemplar", "display"):
        print(f"{name:<20} {len(found[name]['rooms'])} rooms, {found[name]['changes']} changes: "
              f"{', '.join(found[name]['rooms'])}")


if __name__ == "__main__":
    main()
