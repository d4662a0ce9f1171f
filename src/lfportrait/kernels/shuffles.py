"""Two more operations on lanes: rounding to half precision, and a small matrix applied to a row."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .identity import identified
from .lanes import WIDTH, F

__all__ = ["make_restrict", "store_half"]

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


@functools.cache
def make_restrict(count: int, terms: int) -> Callable[..., Any]:
    """Coefficients of each channel through a matrix, all channels at once.

    Parameters
    ----------
    count
        Coefficients a channel in a row: the row is [3, count], zero-padded to 16 or 32 values.
    terms
        Coefficients a channel in the result, [3, terms] in 16 lanes.

    Returns
    -------
    restrict
        ``restrict(first, rest, matrix)``: lanes of a row's first and next 16 values (the same
        lanes twice for rows of 16); ``matrix`` float32 [count * 16], for each of the row's
        coefficients its weight in the 16 results, lane ``terms * channel + term``.
    """
    @identified("restrict", count, terms)
    @intrinsic
    def restrict(typing, first, rest, matrix):  # type: ignore[no-untyped-def]
        if first is not F or rest is not F or not isinstance(matrix, types.Array):
            return None

        def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
            fma = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(_VF, [_VF] * 3), "llvm.fma.v16f32")
            result = ir.Constant(_VF, [0.0] * WIDTH)
            for part in range(count):
                # Lane terms * channel + term takes the row's value count * channel + part.
                chosen = [min(lane // terms, 2) * count + part for lane in range(WIDTH)]
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
