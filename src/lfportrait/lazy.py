"""Lazy imports: packages load their modules on first access.

Numba, torch and SciPy take seconds to import; a command that needs none of them should not wait. A
package states what it offers as imports under ``if TYPE_CHECKING`` - for readers, type checkers and
the drawing of the house - and ends with::

    __getattr__, __dir__ = attach(__name__, __file__)
"""

from __future__ import annotations

import ast
import sys
import threading
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

__all__ = ["attach", "syntax_tree"]

_PARSING = threading.Lock()


def syntax_tree(text: str) -> ast.Module:
    """The syntax tree of a text, from any thread.

    Where two threads parse at a time, Python 3.11 may count their depths together and fail with
    "AST constructor recursion depth mismatch" (CPython issue 106905).
    """
    with _PARSING:
        return ast.parse(text)


def _homes(file: str) -> dict[str, tuple[str, str]]:
    """Module, and name in it, of all that a file imports under ``if TYPE_CHECKING``."""
    with open(file, encoding="utf-8") as stream:
        tree = syntax_tree(stream.read())
    blocks = [node for node in tree.body if isinstance(node, ast.If)]
    return {alias.asname or alias.name: ("." * node.level + (node.module or ""), alias.name)
            for block in blocks for node in block.body if isinstance(node, ast.ImportFrom)
            for alias in node.names}


def attach(package: str, file: str, moved: Mapping[str, str] | None = None,
           ) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """A package's ``__getattr__`` and ``__dir__`` for what its file imports for type checkers.

    Parameters
    ----------
    package
        The package's ``__name__``.
    file
        Its ``__file__``.
    moved
        Names that it had, and the packages that have them now, for the message.
    """
    homes = _homes(file)

    def get(name: str) -> Any:
        if name not in homes:
            place = (moved or {}).get(name)
            hint = f": it is in {place} now" if place else ""
            raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")
        home, original = homes[name]
        return getattr(import_module(home, package), original)

    def names() -> list[str]:
        return sorted({*homes, *vars(sys.modules[package])})

    return get, names
