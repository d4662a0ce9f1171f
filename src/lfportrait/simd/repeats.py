"""Numba compiles with less repetition: it keeps what it has answered before.

Two thirds of the time to compile a kernel pass in Numba's Python. It goes over all of a function's
calls until their types stay as they are, and finds out again each time what each call means. It
inspects the signature of its own code for an addition at each addition, has LLVM parse a module to
say how large a number is, and colors messages of errors that it catches itself. Of a kernel that
comes from the disk it parses what a caller would be compiled with, and lists all symbols in it.
Without this, kernels compile in four fifths of the time, to the same code, and are read in three
fifths.

Numba's private parts are replaced here, in the versions that this was tested with; all others
compile as they always did.
"""

import functools
from collections.abc import Callable
from typing import Any

import numba
from llvmlite.binding import parse_bitcode
from numba.core import analysis, base, errors, ir, typeinfer, types
from numba.core.codegen import JITCodeLibrary
from numba.core.typing import context as typing_context

TESTED = "0.68."  # The versions of Numba whose private parts these are.

_Replaced = Callable[[Any], Callable[..., Any]]


def replace_in_numba(owner: Any, name: str) -> Callable[[_Replaced], None]:
    """Decorate what makes a function from the one that ``owner`` has by a name, to take its place.

    The new one keeps the old one as ``__wrapped__``, for tests.
    """
    def decorate(make: _Replaced) -> None:
        before = getattr(owner, name, None)
        if before is not None and numba.__version__.startswith(TESTED):
            setattr(owner, name, functools.wraps(before)(make(before)))
    return decorate


@replace_in_numba(typeinfer.TypeInferer, "resolve_call")
def _calls(before: Any) -> Callable[..., Any]:
    """What a call of one of Numba's own functions means, once for a function that is compiled."""
    def resolve_call(self: Any, function: Any, positional: Any, named: Any) -> Any:
        # A compiled function of ours may be one that is still compiled: it calls itself.
        if not isinstance(function, (types.Function, types.BoundFunction)):
            return before(self, function, positional, named)
        kept = vars(self).setdefault("_kept_calls", {})
        # Equal types are one object, and what lies in `kept` stays that object.
        key = (id(function), *map(id, positional), *named, *map(id, named.values()))
        found = kept.get(key)
        if found is None:
            signature = before(self, function, positional, named)
            if signature is None or not signature.return_type.is_precise():
                return signature
            found = kept[key] = signature, function, positional, named
        return found[0]
    return resolve_call


_NO_VARIABLES = {str, int, bool, type(None), ir.Loc}
"""Types of a statement's parts that are neither variables nor hold any."""


def _add_variables(value: Any, found: list[Any]) -> None:
    kind = type(value)
    if kind in _NO_VARIABLES:
        return
    if issubclass(kind, ir.Var):
        found.append(value)
    elif issubclass(kind, ir.Inst):
        found += value.list_vars()
    elif issubclass(kind, (list, tuple)):
        for one in value:
            _add_variables(one, found)
    elif issubclass(kind, dict):
        for one in value.values():
            _add_variables(one, found)
    else:
        _NO_VARIABLES.add(kind)


@replace_in_numba(ir.Inst, "_rec_list_vars")
def _variables(before: Any) -> Callable[..., Any]:
    """The variables of a statement, by the types of its parts, which are few."""
    def list_variables(self: Any, value: Any) -> list[Any]:
        found: list[Any] = []
        _add_variables(value, found)
        return found
    return list_variables


@replace_in_numba(analysis, "compute_live_map")
def _alive(before: Any) -> Callable[..., Any]:
    """The variables that live at each block's begin, as bits of a number instead of sets."""
    def compute_live_map(cfg: Any, blocks: Any, used: Any, defined: Any) -> dict[Any, set[str]]:
        names = sorted(set().union(*used.values(), *defined.values()))
        bit = {name: 1 << place for place, name in enumerate(names)}
        uses, defines = ({block: sum(map(bit.__getitem__, some[block])) for block in blocks}
                         for some in (used, defined))
        order = cfg.topo_order()
        links = [(block, [after for after, _ in cfg.successors(block)]) for block in order]
        reach, last = {block: uses[block] | defines[block] for block in blocks}, None
        while reach != last:
            last = dict(reach)
            for block, successors in links:
                for after in successors:
                    reach[after] |= reach[block]
        links = [(block, [start for start, _ in cfg.predecessors(block)])
                 for block in reversed(order)]
        alive, last = dict(uses), None
        while alive != last:
            last = dict(alive)
            for block, predecessors in links:
                for start in predecessors:
                    alive[start] |= alive[block] & reach[start] & ~defines[start]
        return {block: {names[place] for place, digit in enumerate(bin(word)[:1:-1])
                        if digit == "1"} for block, word in alive.items()}
    return compute_live_map


@replace_in_numba(base, "_has_loc")
def _signatures(before: Any) -> Callable[..., Any]:
    """Whether Numba's code for an operation takes its place in the source."""
    return functools.lru_cache(4096)(before)


@replace_in_numba(base.BaseContext, "get_abi_sizeof")
def _sizes(before: Any) -> Callable[..., Any]:
    """The size of a type without a name of its own."""
    known: dict[str, int] = {}

    def get_abi_sizeof(self: Any, kind: Any) -> int:
        text = str(kind)
        if "%" in text:
            return int(before(self, kind))
        if text not in known:
            known[text] = before(self, kind)
        return known[text]
    return get_abi_sizeof


def _registered(context: Any) -> list[int]:
    """How much is registered where a context has looked; it becomes only more."""
    return [len(getattr(registry, name)) for registry, loader in context._registries.items()
            for name in loader.registry_items]


def _news(before: Any) -> Callable[..., Any]:
    """Look into the registries only where there is something new."""
    def refresh(self: Any) -> None:
        if vars(self).get("_registered_before") != _registered(self):
            before(self)
            self._registered_before = _registered(self)
        elif hasattr(self, "typing_context"):
            self.typing_context.refresh()
    return refresh


replace_in_numba(base.BaseContext, "refresh")(_news)
replace_in_numba(typing_context.BaseContext, "refresh")(_news)


@replace_in_numba(getattr(errors, "HighlightColorScheme", None), "_markup")
def _colors(before: Any) -> Callable[..., Any]:
    """Messages without colors, for which standard output would be wrapped and unwrapped each."""
    return lambda self, message, *_, **__: message


class _Found(JITCodeLibrary):
    """Machine code from the disk; bitcode for its callers, parsed when one is compiled."""

    _bitcode = b""
    _parsed: Any = None

    @property
    def _shared_module(self) -> Any:
        if self._parsed is None and self._bitcode:
            self._parsed = parse_bitcode(self._bitcode)
            self._codegen._engine._load_defined_symbols(self._parsed)
        return self._parsed

    @_shared_module.setter
    def _shared_module(self, module: Any) -> None:
        self._parsed = module

    def get_pointer_to_function(self, name: str) -> int:
        # Names in bitcode are plain: it is asked for an entrance, which it defines if it names it.
        if name.encode() in self._bitcode:
            self._ensure_finalized()
            return int(self._codegen._engine.get_function_address(name))
        return int(super().get_pointer_to_function(name)) if self._shared_module else 0


@replace_in_numba(JITCodeLibrary, "_unserialize")
def _read(before: Any) -> Callable[..., Any]:
    """A function's code from what is on the disk."""
    def unserialize(codegen: Any, state: Any) -> Any:
        name, kind, data = state
        if kind != "object":
            return before(codegen, state)
        library = _Found(codegen, name)
        machine, library._bitcode = data
        library.enable_object_caching()
        library._set_compiled_object(machine)
        library._finalize_final_module()
        return library
    return unserialize
