"""Decorators that compile kernels, lean and without reference counting, and keep what is compiled.

Numba counts an array's users whenever it gets another name, by an atomic operation on memory that
all threads share: in a loop that hands arrays to small functions, up to two thirds of the time. So
what a kernel does with a row or a tile is a `lean` function: its arrays are its caller's, who keeps
them; it makes none of its own.

Besides a function's own code Numba compiles two entrances to it, one for Python and one for C, each
with all that the function calls. Nobody takes the second one, and only a `kernel` has the first.

A `woven` function is a lean one that leaves no call: its machine code goes into each place that
calls it. Numba's own way to do that with a function's source (``inline="always"``) compiles it in
each place again; it is for a function with one caller.

In all of them divisions by zero give infinity or NaN, as in NumPy.

Numba finds a function's compiled code on disk by a hash of its bytecode and of a pickle of what it
closes over, which differs from process to process where that is another compiled function. So
functions of a factory get an identity from their names, the factory's parameters and the kernels'
sources, and are found by it alone; an edit of any kernel recompiles all of them.

The identity becomes part of the function's name, too. Numba distinguishes functions of one name by
the order in which a process compiled them, and code that comes from the disk keeps the number of
the process that wrote it: two products of a factory could bear one symbol, and the linker would
take either for both. Their files on the disk differ for the same reason.

Processes that compile one function for other types at the same time would both take the next number
for their code. So they add to a function's files one after the other.
"""

import contextlib
import functools
import hashlib
import operator
import uuid
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import Any

import numba
from llvmlite.binding import parse_assembly
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.typing import arraydecl, templates
from numba.core.typing.templates import infer_global

from ..files import lock
from .repeats import replace_in_numba

_LOCK = "kernels.lock"  # A file beside compiled code, locked while some is added.
_PATIENCE = 2.0
"""Seconds to wait for another process: one that is paused just then must not hold up all others."""


def kernel_files() -> list[Path]:
    """The files with kernels, and those of what they are made of, in order."""
    package = Path(__file__).parents[1]
    return sorted([*package.glob("simd/*.py"), *package.rglob("kernels/*.py"),
                   *package.rglob("kernels.py")])


@functools.cache
def kernel_sources() -> str:
    """Hash of the sources of all kernels: the stages' and the lanes they are made of."""
    digest = hashlib.sha256()
    for path in kernel_files():
        digest.update(path.read_bytes())
    return digest.hexdigest()


def identity(function: Any) -> str:
    """The identity of a compiled function, to make others' from it."""
    return str(getattr(function, "_uuid", ""))


class _SharedFiles(IndexDataCacheFile):
    """Numba's files of a function, to which one process adds at a time."""

    def save(self, key: Any, data: Any) -> None:
        with contextlib.ExitStack() as stack:
            # Without a lock, or with another process's, the file is written all the same.
            with contextlib.suppress(OSError):
                stack.callback(lock(Path(self._cache_path) / _LOCK, _PATIENCE).release)
            super().save(key, data)

    def _load_index(self) -> Any:
        """The index; empty where an earlier version wrote it, whose types have other names now."""
        try:
            return super()._load_index()
        except (ImportError, AttributeError):
            return {}


def shared_files(function: Any) -> Any:
    """The same compiled function, to whose files on the disk one process adds at a time."""
    cache = getattr(function, "_cache", None)
    if isinstance(cache, FunctionCache):
        cache._cache_file = _SharedFiles(cache.cache_path, cache._impl.filename_base,
                                         cache._impl.locator.get_source_stamp())
    return function


class _CacheByIdentity(FunctionCache):
    """Numba's cache of a function on the disk, whose key is the function's identity."""

    def __init__(self, function: FunctionType, number: str) -> None:
        super().__init__(function)
        self._number = number

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        return sig, codegen.magic_tuple(), self._number


def identified(*parts: Any) -> Callable[[Any], Any]:
    """Decorate a factory's compiled function (outermost) with an identity made of ``parts``.

    These are its name, and all arguments of the factory.
    """
    def set_identity(function: Any) -> Any:
        name = repr((kernel_sources(), *parts))
        # Of a namespace's entries only compiled functions have a place in Numba's cache.
        if hasattr(function, "_set_uuid"):
            number = str(uuid.uuid5(uuid.NAMESPACE_OID, name))
            function._set_uuid(number)
            if hasattr(function, "py_func"):
                function.py_func.__qualname__ += f"_{number.replace('-', '')[:12]}"
                if isinstance(function._cache, FunctionCache):
                    function._cache = _CacheByIdentity(function.py_func, number)
                    shared_files(function)
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


class _Code(JITCodeLibrary):
    """Code of a function, which LLVM goes over once, together with the code of all that it calls.

    Numba has it go over the function alone first, then over all of it in two rounds. That brings
    together what counts an array's users, of which there is little here, and the last round does
    all the rest again: a tenth of the time to compile went into it.
    """

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


class _Ingredient(_Code):
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


class _KernelCompiler(Compiler):  # type: ignore[misc]
    """Numba's compiler, with a kernel's code."""

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        if self.state.library is None:
            self.state.library = _Code(self.state.targetctx.codegen(), func.__qualname__)
            self.state.library.enable_object_caching()
        return super().compile_extra(func)


class _IngredientCompiler(Compiler):  # type: ignore[misc]
    """Numba's compiler, up to machine code."""

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        if self.state.library is None:
            self.state.library = _Ingredient(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


@replace_in_numba(templates._OverloadFunctionTemplate, "_get_jit_decorator")
def _ingredients(before: Any) -> Callable[..., Any]:
    """Numba's own functions, of which some are Python, without entrances that nobody takes."""
    def decorator(self: Any) -> Callable[..., Any]:
        return functools.partial(before(self), no_cpython_wrapper=True, no_cfunc_wrapper=True,
                                 pipeline_class=_IngredientCompiler)
    return decorator


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


kernel = _compiler(pipeline_class=_KernelCompiler)  # Compile a function that Python calls.
lean_kernel = _compiler(_nrt=False, pipeline_class=_KernelCompiler)
"""Compile a function that Python calls and that makes no arrays."""
_part = _compiler(no_cpython_wrapper=True, pipeline_class=_IngredientCompiler)
_lean = _compiler(_nrt=False, no_cpython_wrapper=True, pipeline_class=_IngredientCompiler)


def part(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function that only kernels call and that may make arrays."""
    return _within(_part, function, options)


def lean(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function that makes no arrays and is called only by kernels."""
    return _within(_lean, function, options)


def woven(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function that makes no arrays, once, into each place of kernels that calls it."""
    return lean(function, forceinline=True, **options)


def _within(compiler: Callable[..., Any], function: Callable[..., Any] | None,
            options: dict[str, Any]) -> Any:
    """A function that Python can't call, or a decorator that makes one."""
    if function is None:
        return lambda function: _within(compiler, function, options)
    compiled = compiler(function, **options)
    # Python would jump to the entrance that is not there: let it find none, and say so.
    compiled._insert = lambda *_, **__: None
    compiled._compile_for_args = _refuse
    return compiled


def _refuse(*_: Any, **__: Any) -> None:
    raise TypeError("this function is called by kernels only")
