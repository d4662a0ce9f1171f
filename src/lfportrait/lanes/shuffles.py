"""More operations on lanes: half precision, extremes, and short rows read at random."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .cache_keys import identified
from .decorators import lean
from .processor import features, narrowed, widened
from .types import WIDTH, F, I
from .vectors import gather_pair

__all__ = ["largest", "make_look_up", "smallest", "store_half"]

_VF = ir.VectorType(ir.FloatType(), WIDTH)
_VI = ir.VectorType(ir.IntType(32), WIDTH)


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any, index_type: Any,
             vector: ir.Type) -> Any:
    base = context.make_array(array_type)(context, builder, array).data
    place = context.cast(builder, index, index_type, types.uintp)
    return builder.bitcast(builder.gep(base, [place]), vector.as_pointer())


@identified("lanes", "store half")
@intrinsic
def store_half(typing, array, start, value):  # type: ignore[no-untyped-def]
    """array[start : start + 16] = value rounded to float16, for a C-contiguous uint16 array."""
    if not isinstance(array, types.Array) or array.dtype != types.uint16 or value is not F:
        return None

    def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
        address = _address(context, builder, sig.args[0], args[0], args[1], sig.args[1],
                           ir.VectorType(ir.IntType(16), WIDTH))
        builder.store(narrowed(builder, args[2]), address, align=2)
        return context.get_dummy_value()
    return types.none(array, start, value), code


def _has_permutes() -> bool:
    """Whether this processor picks 16-bit values from two registers in one step (AVX-512 BW)."""
    return bool(features().get("avx512bw"))


def make_look_up(permutes: bool | None = None) -> Callable[..., Any]:
    """Neighbouring values of a short stretch of a row, as linear interpolation wants them.

    Parameters
    ----------
    permutes
        Whether to pick values in registers (AVX-512 BW) or gather them; what the processor can by
        default.

    Returns
    -------
    look_up
        ``look_up(array, start, index)``: the float16 values array[start + index] and
        array[start + index + 1] lane by lane, as two float lanes. The array is C-contiguous uint16
        and holds 64 values from ``start`` on; int lanes ``index`` lie in 0..62.
    """
    if not (_has_permutes() if permutes is None else permutes):
        @identified("look up", False)
        @lean
        def gathered(array, start, index):  # type: ignore[no-untyped-def]
            return gather_pair(array, index + np.int32(start))
        return gathered
    pair = types.UniTuple(F, 2)
    short = ir.VectorType(ir.IntType(16), WIDTH)
    table = ir.VectorType(ir.IntType(16), 2 * WIDTH)

    @identified("look up", True)
    @intrinsic
    def look_up(typing, array, start, index):  # type: ignore[no-untyped-def]
        if not isinstance(array, types.Array) or array.dtype != types.uint16 or index is not I:
            return None

        def halves(context, builder, pair_of_lanes):  # type: ignore[no-untyped-def]
            values = []
            for half in range(2):
                order = ir.Constant(_VI, list(range(WIDTH * half, WIDTH * (half + 1))))
                part = builder.shuffle_vector(
                    pair_of_lanes, ir.Constant(table, ir.Undefined), order)
                values.append(widened(builder, part))
            return context.make_tuple(builder, pair, values)

        def permute(context, builder, sig, args):  # type: ignore[no-untyped-def]
            parts = []
            for offset in (0, 2 * WIDTH):
                place = builder.add(context.cast(builder, args[1], sig.args[1], types.uintp),
                                    ir.Constant(ir.IntType(64), offset))
                address = _address(context, builder, sig.args[0], args[0], place, types.uintp,
                                   table)
                parts.append(builder.load(address, align=2))
            low = builder.trunc(args[2], short)
            high = builder.add(low, ir.Constant(short, [1] * WIDTH))
            order = ir.Constant(ir.VectorType(ir.IntType(32), 2 * WIDTH), list(range(2 * WIDTH)))
            both = builder.shuffle_vector(low, high, order)
            pick = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(table, [table] * 3),
                "llvm.x86.avx512.vpermi2var.hi.512")
            return halves(context, builder, builder.call(pick, [parts[0], both, parts[1]]))

        return pair(array, start, index), permute
    return look_up


def _extreme(less: str) -> Callable[..., Any]:
    @intrinsic
    def function(typing, value):  # type: ignore[no-untyped-def]
        if value is not F:
            return None

        def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
            # Four halvings; LLVM's own reduction minds NaN and goes lane by lane.
            value = args[0]
            for distance in (8, 4, 2, 1):
                order = ir.Constant(_VI, [(lane + distance) % WIDTH for lane in range(WIDTH)])
                other = builder.shuffle_vector(value, value, order)
                value = builder.select(builder.fcmp_ordered(less, value, other), value, other)
            return builder.extract_element(value, ir.Constant(ir.IntType(32), 0))
        return types.float32(F), code
    return function


smallest = identified("lanes", "smallest")(_extreme("<"))
"""The least of float lanes, none of them NaN, as a number."""
largest = identified("lanes", "largest")(_extreme(">"))
"""The greatest of float lanes, none of them NaN, as a number."""
