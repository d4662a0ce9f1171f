"""The same identity in every process for functions that a factory makes, so that caching works.

Numba finds a function's compiled code on disk by a hash of its bytecode and of what it closes over.
Another compiled function among the latter counts by a random identity, so that code of a factory's
function is never found again: each process would compile it anew and add another file. Here such
functions get an identity from their names, the factory's parameters and the kernels' sources; an
edit of any kernel compiles all of them anew.

The identity becomes part of the function's name, too. Numba tells functions of one name apart by
the order in which a process compiled them, and code that comes from the disk keeps the number of
the process that wrote it: two products of a factory could bear one symbol, and the linker would
take either for both.

What is hashed is a pickle, in which a string that comes twice is written once if it is one object,
but twice if it is two equal ones. A module's file name is one object in the process that compiled
the module from its source and two in all later ones, which read its bytecode: they would compile
all kernels of factories once more.
"""

from __future__ import annotations

import functools
import hashlib
import uuid
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import Any

from llvmlite import ir

__all__ = ["identified", "identified_all", "identity", "kernel_sources"]


@functools.cache
def kernel_sources() -> str:
    """Hash of the sources of all kernels: the stages' and the lanes they are made of."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted([*package.glob("lanes/*.py"), *package.glob("*/kernels/*.py")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def identity(function: Any) -> str:
    """The identity of a compiled function, to make others' from it."""
    return str(getattr(function, "_uuid", ""))


def _name_types(definition: FunctionType | None) -> None:
    """Ask the LLVM types that an intrinsic's definition refers to for their names.

    The definition is hashed with all that it refers to, and a type remembers its name from when it
    is first asked for it: the hash would change by compiling, and the code never be found again.
    """
    if definition is None:
        return
    cells = [cell.cell_contents for cell in definition.__closure__ or ()]
    for value in [*cells, *definition.__globals__.values()]:
        if isinstance(value, ir.Type):
            str(value)


def _same_file_name(function: Any) -> None:
    """Let a function's module and its code name their file by one object."""
    module, name = function.__globals__, function.__code__.co_filename
    if module.get("__file__") == name:
        module["__file__"] = name


def identified(*parts: Any) -> Callable[[Any], Any]:
    """Decorate a factory's compiled function (outermost) with an identity made of ``parts``.

    Parameters
    ----------
    parts
        What tells the function from all others: its name, and all that the factory was given.
    """
    def set_identity(function: Any) -> Any:
        name = repr((kernel_sources(), *parts))
        # Of a namespace's entries only compiled functions have a place in Numba's cache.
        if hasattr(function, "_set_uuid"):
            _name_types(getattr(function, "_defn", None))
            number = uuid.uuid5(uuid.NAMESPACE_OID, name)
            function._set_uuid(str(number))
            if hasattr(function, "py_func"):
                function.py_func.__qualname__ += f"_{number.hex[:12]}"
            _same_file_name(getattr(function, "py_func", None) or function._defn)
        return function
    return set_identity


def identified_all(name: str, width: int, functions: SimpleNamespace) -> None:
    """Give the functions of a namespace identities from its name, its width and theirs."""
    known: set[int] = set()
    for key, function in vars(functions).items():
        # A function under two names keeps its first identity.
        if key not in ("width", "jit") and id(function) not in known:
            known.add(id(function))
            identified(name, width, key)(function)
