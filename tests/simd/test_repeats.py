"""Numba with less repetition answers as it does by itself."""

import numba
import numpy as np
import pytest
from llvmlite import ir as llvm
from numba.core import analysis, base, errors, ir, typeinfer
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import run_frontend
from numba.core.registry import cpu_target
from numba.core.typing import context, templates
from numba.extending import overload

from lfportrait.simd.decorators import kernel

REPLACED = ((typeinfer.TypeInferer, "resolve_call"), (ir.Inst, "_rec_list_vars"),
            (analysis, "compute_live_map"), (base, "_has_loc"),
            (base.BaseContext, "get_abi_sizeof"), (base.BaseContext, "refresh"),
            (context.BaseContext, "refresh"),
            (templates._OverloadFunctionTemplate, "_get_jit_decorator"),
            (JITCodeLibrary, "_unserialize"))


def straight(a, b):
    return a + b


def winding(values, limit):
    found, last = [], -1
    for number, value in enumerate(values):
        if value > limit:
            while value > limit and number >= 0:
                value //= 2
                last = number
                if value == 3:
                    break
            else:
                continue
        found.append((value, {"last": last}))
    return found, last


def test_each_part_is_there_to_be_replaced():
    for owner, name in REPLACED:
        assert hasattr(getattr(owner, name), "__wrapped__"), name


@pytest.mark.parametrize("function", [straight, winding])
def test_a_functions_variables_are_those_that_numba_finds(function):
    blocks = run_frontend(function).blocks
    statements = [statement for block in blocks.values() for statement in block.body]
    for statement in statements:
        theirs = ir.Inst._rec_list_vars.__wrapped__(statement, vars(statement))
        assert [v.name for v in statement.list_vars()] == [v.name for v in theirs]
    graph = analysis.compute_cfg_from_blocks(blocks)
    found = analysis.compute_use_defs(blocks)
    alive = analysis.compute_live_map(graph, blocks, found.usemap, found.defmap)
    assert alive == analysis.compute_live_map.__wrapped__(graph, blocks, found.usemap,
                                                          found.defmap)
    assert (function is straight) or any(alive.values())


def test_a_call_is_asked_for_again_when_its_types_have_changed():
    @numba.njit
    def total(values):
        found = 0
        for n in range(len(values)):
            found = max(found + values[n], found)  # an integer at first
        return found

    assert total(np.array([0.25, 0.5])) == 0.75
    assert total(np.array([2, 3])) == 5
    assert [s.return_type for s in (o.signature for o in total.overloads.values())] == [
        numba.float64, numba.int64]


def test_what_is_registered_later_is_found():
    def thrice(value):
        raise NotImplementedError

    @numba.njit
    def before(value):
        return value + 1

    assert before(1) == 2

    @overload(thrice)
    def of_numbers(value):
        return lambda value: 3 * value

    assert numba.njit(lambda value: thrice(value))(2) == 6


def test_an_unknown_meaning_is_told_without_colors():
    @numba.njit
    def wrong(value):
        return value.nothing

    with pytest.raises(errors.TypingError, match="Unknown attribute 'nothing'") as told:
        wrong(1)
    assert "\x1b" not in str(told.value)


def test_sizes_of_types():
    size = cpu_target.target_context.get_abi_sizeof
    pair = llvm.LiteralStructType([llvm.IntType(8), llvm.DoubleType()])
    for _ in range(2):
        assert [size(kind) for kind in (llvm.IntType(32), llvm.DoubleType(), pair)] == [4, 8, 16]


def threefold(value):
    return 3 * value + 1


def test_code_from_the_disk_is_what_numba_reads():
    function = numba.njit(threefold)
    assert function(2) == 7
    [compiled] = function.overloads.values()
    codegen = cpu_target.target_context.codegen()
    kept = compiled.library.serialize_using_object_code()
    found, theirs = (read(codegen, kept) for read in (
        JITCodeLibrary._unserialize, JITCodeLibrary._unserialize.__wrapped__))
    entrance = compiled.fndesc.llvm_cpython_wrapper_name
    assert found.get_pointer_to_function(entrance) and theirs.get_pointer_to_function(entrance)
    assert found._parsed is None, "its entrance needs no bitcode"
    assert found.get_pointer_to_function("no_such_function") == 0
    assert str(found._get_module_for_linking()) == str(theirs._get_module_for_linking())
    assert found.get_pointer_to_function(entrance)


def test_code_from_the_disk_is_put_into_what_calls_it():
    assert kernel(threefold)(2) == 7
    again = kernel(threefold)
    assert again(3) == 10 and sum(again.stats.cache_hits.values()) == 1
    caller = numba.njit(lambda value: again(value) + again(value + 1))
    assert caller(4) == 13 + 16
