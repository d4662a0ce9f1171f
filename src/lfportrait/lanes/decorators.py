"""Decorators that compile kernels, lean and without reference counting.

Numba counts an array's users whenever it gets another name, and each count is an atomic operation
on memory that all threads share. In a loop that hands arrays to small functions this took up to two
thirds of the time of one thread, and more of two that copy from the same exemplar. So what a
kernel does with a row or a tile is a `lean` function: its arrays are its caller's, who
keeps them; it makes none of its own.

Besides a function's own code Numba compiles two entrances to it, one for Python and one for C, each
with all that the function calls. Nobody takes the second one, and only a `kernel` has the first.

A `woven` function is a lean one that leaves no call: its code goes into each place that calls it.
Numba can do the same with a function's source (``inline="always"``), but then checks, types and
translates it again in each place, several times the work for the same machine code. That is for a
function with one caller.

In all of them divisions by zero give infinity or NaN, as in NumPy.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numba
from llvmlite.binding import parse_assembly
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.typing import arraydecl
from numba.core.typing.templates import infer_global

from .cache_keys import shared_files

__all__ = ["kernel", "lean", "lean_kernel", "woven"]


def _asked_first(function: Callable[..., Any], meaning: Any) -> None:
    """Have Numba ask for one meaning of an operator before all others.

    Numba asks one after the other what a[i] means: for strings, lists, records and dozens more,
    arrays last. It asks what is made for one kind of processor before what is general.
    """
    infer_global(function)(type(meaning.__name__, (meaning,), {"metadata": {"target": "cpu"}}))


# Numba's types leave its own meanings out.
_meanings: Any = arraydecl
_asked_first(operator.getitem, _meanings.GetItemBuffer)
_asked_first(operator.setitem, _meanings.SetItemBuffer)


class _Ingredient(JITCodeLibrary):
    """Code of a function that is put into others', and is never run by itself.

    It is optimised like others', but not turned into machine code: that takes a tenth of the time,
    and each caller's has it anyway.
    """

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        # Numba keeps what a function knows of its module at an address with this name.
        names = [variable.name for variable in self._final_module.global_variables
                 if variable.name.startswith("_ZN08NumbaEnv")
                 and not self._codegen._engine.is_symbol_defined(variable.name)]
        module = self._codegen._create_empty_module(self.name)
        code = [str(module), *(f'@"{name}" = common global ptr null' for name in names)]
        self._codegen._add_module(parse_assembly("\n".join(code)))
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> Any:
        return self.serialize_using_bitcode()


class _IngredientCompiler(Compiler):  # type: ignore[misc]
    """Numba's compiler, up to machine code."""

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        if self.state.library is None:
            self.state.library = _Ingredient(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


def _compiler(**options: Any) -> Callable[..., Any]:
    """Numba's decorator with options, those of a single function among its keywords."""
    def decorate(function: Callable[..., Any] | None = None, **more: Any) -> Any:
        if function is None:
            return lambda function: decorate(function, **more)
        # Numba's types leave some options out.
        compiler: Any = numba.njit
        return shared_files(compiler(cache=True, nogil=True, error_model="numpy",
                                     no_cfunc_wrapper=True, **options, **more)(function))
    return decorate


kernel = _compiler()
"""Compile a function that Python calls."""
lean_kernel = _compiler(_nrt=False)
"""Compile a function that Python calls and that makes no arrays."""
_lean = _compiler(_nrt=False, no_cpython_wrapper=True, pipeline_class=_IngredientCompiler)


def lean(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function that makes no arrays and is called only by kernels."""
    if function is None:
        return lambda function: lean(function, **options)
    compiled = _lean(function, **options)
    # Python would jump to the entrance that is not there: let it find none, and say so.
    compiled._insert = lambda *_, **__: None
    compiled._compile_for_args = _refuse
    return compiled


def woven(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function that makes no arrays, once, into each place of kernels that calls it."""
    return lean(function, forceinline=True, **options)


def _refuse(*_: Any, **__: Any) -> None:
    raise TypeError("a lean function is called by kernels only")
