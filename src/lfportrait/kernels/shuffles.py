"""More operations on lanes: rounding to half precision, extremes, a small matrix for a row."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .identity import identified
from .lanes import WIDTH, F, I

__all__ = ["gather_quad", "largest", "make_restrict", "smallest", "store_half"]

_VF = ir.VectorType(ir.FloatType(), WIDTH)
_VH = ir.VectorType(ir.HalfType(), WIDTH)


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any, index_type: Any,
             vector: ir.Type) -> Any:
    base = context.make_array(array_type)(context, builder, array).data
    place = context.cast(builder, index, index_type, types.uintp)
    return builder.bitcast(builder.gep(base, [place]), vector.as_pointer())


@intrinsic
def store_half(typing, array, start, value):  # type: ignore[no-untyped-def]
    """array[start : start + 16] = value rounded to float16, for a C-contiguous uint16 array."""
    if not isinstance(array, types.Array) or array.dtype != types.uint16 or value is not F:
        return None

    def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
        address = _address(context, builder, sig.args[0], args[0], args[1], sig.args[1], _VH)
        builder.store(builder.fptrunc(args[2], _VH), address, align=2)
        return context.get_dummy_value()
    return types.none(array, start, value), code


@intrinsic
def gather_quad(typing, array, index):  # type: ignore[no-untyped-def]
    """The float16 values array[index] to array[index + 3] lane by lane, as four float lanes.

    The array is C-contiguous uint16; ``index`` holds non-negative int lanes. It takes the time of
    one value a lane: gathers count elements, not bytes.
    """
    if not isinstance(array, types.Array) or array.dtype != types.uint16 or index is not I:
        return None
    quad = types.UniTuple(F, 4)

    def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
        long = ir.VectorType(ir.IntType(64), WIDTH)
        base = context.make_array(sig.args[0])(context, builder, args[0]).data
        offsets = builder.sext(args[1], long)
        addresses = _addresses(builder, base, offsets)
        gather = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(
                long, [addresses.type, ir.IntType(32), ir.VectorType(ir.IntType(1), WIDTH), long]),
            "llvm.masked.gather.v16i64.v16p0")
        words = builder.bitcast(builder.call(gather, [
            addresses, ir.Constant(ir.IntType(32), 2),
            ir.Constant(ir.VectorType(ir.IntType(1), WIDTH), [1] * WIDTH),
            ir.Constant(long, ir.Undefined)]), ir.VectorType(ir.IntType(32), 2 * WIDTH))
        values = []
        for odd in range(2):
            order = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH),
                                [2 * lane + odd for lane in range(WIDTH)])
            pair = builder.shuffle_vector(words, ir.Constant(words.type, ir.Undefined), order)
            for shift in (0, 16):
                short = builder.trunc(builder.lshr(pair, ir.Constant(pair.type, [shift] * WIDTH)),
                                      ir.VectorType(ir.IntType(16), WIDTH))
                values.append(builder.fpext(builder.bitcast(short, _VH), _VF))
        return context.make_tuple(builder, quad, values)
    return quad(array, index), code


def _addresses(builder: Any, base: Any, offsets: Any) -> Any:
    """base[offset] for every lane of an array of 16-bit values."""
    base = builder.bitcast(base, ir.PointerType())
    instruction = ir.instructions.GEPInstr(builder.block, base, [offsets], inbounds=False, name="",
                                           source_etype=ir.IntType(16))
    instruction.type = ir.VectorType(ir.PointerType(), WIDTH)
    builder._insert(instruction)
    return instruction


def _extreme(code_of: str) -> Callable[..., Any]:
    @intrinsic
    def function(typing, value):  # type: ignore[no-untyped-def]
        if value is not F:
            return None

        def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
            reduce = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(ir.FloatType(), [_VF]), code_of)
            return builder.call(reduce, [args[0]])
        return types.float32(F), code
    return function


smallest = identified("lanes", "smallest")(_extreme("llvm.vector.reduce.fmin.v16f32"))
"""The least of float lanes, as a number."""
largest = identified("lanes", "largest")(_extreme("llvm.vector.reduce.fmax.v16f32"))
"""The greatest of float lanes, as a number."""


@functools.cache
def make_restrict(count: int) -> Callable[..., Any]:
    """Coefficients of each channel through a matrix, all channels at once.

    Parameters
    ----------
    count
        Coefficients a channel in a row: the row is [3, count], zero-padded to 16 or 32 values.

    Returns
    -------
    restrict
        ``restrict(first, rest, matrix)``: lanes of a row's first and next 16 values (the same
        lanes twice for rows of 16); ``matrix`` float32 [count * 16], for each of the row's
        coefficients its weight in the results [3, 4], lane
        ``4 * channel + term``; the last four lanes do not count.
    """
    @identified("restrict", count)
    @intrinsic
    def restrict(typing, first, rest, matrix):  # type: ignore[no-untyped-def]
        if first is not F or rest is not F or not isinstance(matrix, types.Array):
            return None

        def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
            fma = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(_VF, [_VF] * 3), "llvm.fma.v16f32")
            result = ir.Constant(_VF, [0.0] * WIDTH)
            for part in range(count):
                # Lane 4 * channel + term takes the row's value count * channel + part.
                chosen = [min(lane // 4, 2) * count + part for lane in range(WIDTH)]
                order = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), chosen)
                values = builder.shuffle_vector(args[0], args[1], order)
                place = ir.Constant(ir.IntType(64), WIDTH * part)
                address = _address(context, builder, sig.args[2], args[2], place, types.uintp,
                                   _VF)
                weights = builder.load(address, align=4)
                result = builder.call(fma, [values, weights, result])
            return result
        return F(first, rest, matrix), code
    return restrict
