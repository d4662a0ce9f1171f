"""Hashes of a module's source code and of all it imports, as an input of cached results.

A result is stale when the code that made it changed. That code is a module, all that it imports,
whatever those import, and the files beside them that they name (pages, shaders, tables). Imports
are read from the sources as text, those in functions included and those for type checkers left out.
A package's front door (``__init__.py``) is looked through: who imports `VoxelField` from
``lfportrait.field`` depends on the module that defines it, not on the whole package. Packages
beside ours, which import it, are read in the same way where a module of theirs makes a result.
"""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from .lazy import syntax_tree
from .states import file_state

__all__ = ["Kept", "Sources"]

_PACKAGE = __name__.partition(".")[0]
_FORMAT = 2


class _Import(NamedTuple):
    """One name that is imported.

    Attributes
    ----------
    home, name
        The module that it is from, and its name there; an empty name for the module itself.
    attributes
        What of it is used, ``face.mattes``; None where it is used as a whole.
    """

    home: str
    name: str
    attributes: list[str] | None = None


class Kept(NamedTuple):
    """Where a text is kept: what reads it, or gives None, and what writes it."""

    read: Callable[[], str | None]
    write: Callable[[str], None]


class _Module(NamedTuple):
    """What a module's text says.

    Attributes
    ----------
    state
        Size and date of the file and of the data beside it, to see whether it changed.
    hash
        Of its text, and of the data files that it names.
    top
        Imports at its top, at run time.
    inside
        Imports within what it defines at its top, by the name of that.
    offers
        Names that it imports at its top or for type checkers: what a front door hands on.
    """

    state: str
    hash: str
    top: list[_Import]
    inside: dict[str, list[_Import]]
    offers: dict[str, _Import]

    @staticmethod
    def restored(state: str, digest: str, top: list[Any], inside: dict[str, Any],
                 offers: dict[str, Any]) -> _Module:
        """From JSON."""
        return _Module(state, digest, [_Import(*one) for one in top],
                       {name: [_Import(*one) for one in found] for name, found in inside.items()},
                       {name: _Import(*one) for name, one in offers.items()})


class Sources:
    """The modules of our package and of some beside it, what each imports, and hashes of it all.

    A module of ours is named from the package on (``"field.reconstruction"``), one of another
    package in full.

    Parameters
    ----------
    folder
        Our package's folder.
    kept
        Where what the files say is kept: reading all of them takes most of a second.
    beside
        Folders of other packages, or files of single modules.
    """

    def __init__(self, folder: Path, kept: Kept | None = None,
                 beside: Iterable[Path] = ()) -> None:
        self._roots, self._kept = (folder, *beside), kept

    def code_of(self, names: Iterable[str]) -> str:
        """Hash of modules and of all that they import.

        Raises
        ------
        KeyError
            If there is no such module.
        """
        digest = hashlib.sha256()
        for name in sorted(self.closure(names)):
            digest.update(f"{name} {self._modules[name].hash}\n".encode())
        return digest.hexdigest()[:32]

    def closure(self, names: Iterable[str]) -> set[str]:
        """Full names of modules and of all that they import."""
        seen: set[tuple[str, str]] = set()
        left = [(name if name in self._modules else f"{_PACKAGE}.{name}", "") for name in names]
        while left:
            place = left.pop()
            if place not in seen:
                seen.add(place)
                left += self._used_by(*place)
        return {module for module, _ in seen}

    def _used_by(self, name: str, part: str) -> Iterator[tuple[str, str]]:
        """What a module uses, or, of a front door, what one of its own functions does."""
        module = self._modules[name]
        imports = module.top + [one for key, found in module.inside.items()
                                if part in ("", key) for one in found]
        for one in imports:
            place = self._defined(one.home, one.name)
            if place is not None and place[1] == "" and one.attributes is not None and (
                    place[0] == f"{one.home}.{one.name}"):
                yield from (inner for name in one.attributes
                            if (inner := self._defined(place[0], name)) is not None)
            elif place is not None:
                yield place

    def _defined(self, home: str, name: str, depth: int = 0) -> tuple[str, str] | None:
        """The module that defines what is imported, and which function of a front door that is."""
        module = self._modules.get(home)
        if module is None:
            return None
        if self._files[home].name == "__init__.py":
            if name in module.offers and depth < 9:
                return self._defined(*module.offers[name][:2], depth + 1)
            if name in module.inside:
                return home, name
        inner = f"{home}.{name}"
        return (inner, "") if inner in self._modules else (home, "")

    @cached_property
    def _files(self) -> dict[str, Path]:
        """Path of each module by its dotted name; a package stands for its ``__init__.py``."""
        found = {}
        for root in self._roots:
            package = _PACKAGE if root == self._roots[0] else root.stem
            for path in (path for path in self._all_files(root) if path.suffix == ".py"):
                inner = () if path == root else path.relative_to(root).with_suffix("").parts
                parts = [package, *inner]
                found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
        return found

    @staticmethod
    def _all_files(root: Path) -> list[Path]:
        return [root] if root.is_file() else sorted(
            path for path in root.rglob("*")
            if path.suffix not in (".pyc", ".nbi", ".nbc") and path.is_file()
            and not path.name.startswith((".", "warm-")))

    @cached_property
    def _data(self) -> dict[Path, list[Path]]:
        """Files that are no modules by the package's folder that they belong to."""
        found: dict[Path, list[Path]] = {}
        for root in self._roots:
            for path in self._all_files(root):
                if path.suffix != ".py":
                    home = path.parent
                    while not (home / "__init__.py").is_file() and home != root:
                        home = home.parent
                    found.setdefault(home, []).append(path)
        return found

    @cached_property
    def _modules(self) -> dict[str, _Module]:
        """What each module says; read again where its file changed."""
        known: dict[str, _Module] = {}
        with suppress(ValueError, TypeError, KeyError, AttributeError):
            data = json.loads((self._kept and self._kept.read()) or "{}")
            if data.get("format") == _FORMAT:
                known = {name: _Module.restored(*row) for name, row in data["modules"].items()}
        found = {}
        for name, path in self._files.items():
            state = self._state(path)
            before = known.get(name)
            found[name] = (before if before is not None and before.state == state
                           else self._read(name, path, state))
        if self._kept is not None and found != known:
            self._kept.write(json.dumps({"format": _FORMAT, "modules": found}))
        return found

    def _state(self, path: Path) -> str:
        states = [file_state(one) for one in (path, *self._data.get(path.parent, []))]
        return " ".join(".".join(map(str, state)) for state in states)

    def _read(self, name: str, path: Path, state: str) -> _Module:
        text = path.read_text(encoding="utf-8")
        digest = hashlib.sha256(text.encode())
        for data in self._data.get(path.parent, []):
            names = {data.name, data.stem, *data.relative_to(path.parent).parts[:-1]}
            if any(f'"{one}' in text or f"/{one}" in text for one in names):
                digest.update(data.read_bytes())
        tree = syntax_tree(text)
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        top: dict[str, _Import] = {}
        offers: dict[str, _Import] = {}
        inside: dict[str, list[_Import]] = {}
        used = _attributes(tree)
        for node in tree.body:
            if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
                offers |= _imports(node, package, used)
            elif isinstance(node, ast.FunctionDef | ast.ClassDef):
                inside[node.name] = list(_imports(node, package, _attributes(node)).values())
            else:
                top |= _imports(node, package, used)
        return _Module(state, digest.hexdigest(), list(top.values()), inside, offers | top)


def _attributes(tree: ast.AST) -> dict[str, list[str]]:
    """What of each name is used (``name.this``), of those that are never used as a whole."""
    parts: dict[str, set[str]] = {}
    owners = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            parts.setdefault(node.value.id, set()).add(node.attr)
            owners.add(node.value)
    whole = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)
             and node not in owners}
    return {name: sorted(found) for name, found in parts.items() if name not in whole}


def _imports(tree: ast.AST, package: str, used: dict[str, list[str]],
             ) -> dict[str, _Import]:
    """What is imported anywhere in a part of a module, by the names that it gets there."""
    found: dict[str, _Import] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.asname or alias.name: _Import(alias.name, "") for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            home = node.module or ""
            if node.level:
                parts = package.split(".")
                above = parts[:len(parts) - node.level + 1]
                home = ".".join([*above, *([node.module] if node.module else [])])
            found |= {(own := alias.asname or alias.name): _Import(home, alias.name, used.get(own))
                      for alias in node.names}
    return found
